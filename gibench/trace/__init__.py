"""What a launch really does to memory: traces of whole work-groups, for any GPU."""
