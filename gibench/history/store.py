"""Where a history is kept: one DuckDB file, or a folder of Parquet files.

A file is quickest to ask and is written by one process at a time, behind a lock. A folder takes
runs from any number of writers on shared storage without a lock: a run is a folder of its own,
renamed into its place when it is whole, and its name is made of its content. Either can be added
to the other.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gibench.errors import BadInput, GibenchError
from gibench.history.entries import TABLES, Entry

if TYPE_CHECKING:
    import pandas as pd

LOCK_SECONDS = 60.0
_EXTRA = "pip install 'gibench[history]'"
_RUNS = "runs"


@dataclass(frozen=True)
class History:
    """A history at ``path``: a DuckDB file where the name ends in ``.duckdb``, else a folder."""

    path: Path

    @property
    def is_file(self) -> bool:
        """Whether it is one DuckDB file."""
        return self.path.suffix == ".duckdb"

    @property
    def exists(self) -> bool:
        """Whether anything was ever added."""
        return self.path.is_file() if self.is_file else (self.path / _RUNS).is_dir()

    def add(self, entries: Iterable[Entry]) -> int:
        """Keep runs; one that is there already is left as it is.

        Returns:
            How many were new.

        Raises:
            GibenchError: it cannot be written, or another process holds it for a minute.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not self.is_file:
                return sum(self._add_folder(entry) for entry in entries)
            with self.connected(write=True) as connection:
                return sum(_insert(connection, entry) for entry in entries)
        except OSError as error:
            raise GibenchError(
                f"cannot be written ({error.strerror or error})", where=self.path
            ) from error

    def ask(self, question: str, parameters: tuple[Any, ...] = ()) -> pd.DataFrame:
        """The answer to a question in SQL over ``runs``, ``configurations`` and ``samples``.

        Raises:
            BadInput: there is no history, or it is none.
        """
        with self.connected() as connection:
            answer: pd.DataFrame = connection.execute(question, list(parameters)).df()
            return answer

    def entries(self) -> Iterator[Entry]:
        """All runs of it, for another history.

        Raises:
            BadInput: there is no history, or it is none.
        """
        with self.connected() as connection:
            names = [row[0] for row in connection.execute("SELECT run FROM runs").fetchall()]
            for name in names:
                tables = {
                    table: connection.execute(f"SELECT * FROM {table} WHERE run = ?", [name]).df()
                    for table in TABLES
                }
                yield Entry(name, tables)

    @contextmanager
    def connected(self, *, write: bool = False) -> Iterator[Any]:
        """A DuckDB connection with the tables of :data:`TABLES`.

        Raises:
            BadInput: there is no history to read, or the file is none.
            GibenchError: another process holds the file for a minute, or duckdb is not installed.
        """
        duckdb = _duckdb()
        if not write and not self.exists:
            raise BadInput(
                "there is no history", where=self.path, mend="begin one with 'gibench history add'"
            )
        if not self.is_file:
            with duckdb.connect() as connection:
                for table in TABLES:
                    files = str(self.path / _RUNS / "*" / f"{table}.parquet").replace("'", "''")
                    connection.execute(
                        f"CREATE VIEW {table} AS SELECT * FROM read_parquet('{files}')"
                    )
                yield connection
            return
        from filelock import FileLock, Timeout

        lock = FileLock(f"{self.path}.lock", timeout=LOCK_SECONDS)
        try:
            with lock, _opened(duckdb, self.path) as connection:
                for table, columns in TABLES.items():
                    fields = ", ".join(f'"{name}" {kind}' for name, kind in columns.items())
                    connection.execute(f"CREATE TABLE IF NOT EXISTS {table} ({fields})")
                yield connection
        except Timeout as error:
            raise GibenchError(
                "another process has held it for a minute",
                where=self.path,
                mend="try again, or keep a folder instead: it needs no lock",
            ) from error

    def _add_folder(self, entry: Entry) -> bool:
        target = self.path / _RUNS / entry.run
        if target.exists():
            return False
        target.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".adding-", dir=self.path))
        try:
            with _duckdb().connect() as connection:
                for table, columns in TABLES.items():
                    connection.register("given", entry.tables[table])
                    casts = (f'"{key}"::{kind} AS "{key}"' for key, kind in columns.items())
                    fields = ", ".join(casts)
                    file = str(temporary / f"{table}.parquet").replace("'", "''")
                    connection.execute(
                        f"COPY (SELECT {fields} FROM given) TO '{file}' (FORMAT parquet)"
                    )
            temporary.chmod(0o755)
            temporary.rename(target)
        except OSError:
            shutil.rmtree(temporary, ignore_errors=True)
            if target.exists():  # another writer was there first with the same run
                return False
            raise
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        return True


def _insert(connection: Any, entry: Entry) -> bool:
    """A run into the tables, whole or not at all."""
    if connection.execute("SELECT 1 FROM runs WHERE run = ?", [entry.run]).fetchone():
        return False
    connection.execute("BEGIN")
    try:
        for table, columns in TABLES.items():
            connection.register("given", entry.tables[table])
            fields = ", ".join(f'"{name}"' for name in columns)
            connection.execute(f"INSERT INTO {table} SELECT {fields} FROM given")
        connection.execute("COMMIT")
    except BaseException:
        connection.execute("ROLLBACK")
        raise
    return True


@contextmanager
def _opened(duckdb: Any, path: Path) -> Iterator[Any]:
    try:
        connection = duckdb.connect(str(path))
    except duckdb.Error as error:
        reason = " ".join(str(error).split("\n")[0].split())
        raise BadInput(f"it is no history ({reason})", where=path) from error
    with connection:
        yield connection


def _duckdb() -> Any:
    try:
        import duckdb
    except ImportError as error:
        raise GibenchError("a history needs duckdb and ruptures", mend=_EXTRA) from error
    return duckdb
