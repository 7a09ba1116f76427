"""The report of a committed run in a real browser, by the keyboard alone, light and dark."""

from __future__ import annotations

import base64
import importlib.util
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.browser import CHROMIUM, Browser, browser
from support.run_folders import entry, record, write_run

from gibench.cli.main import call

REFERENCE = Path(__file__).parents[2] / "results" / "reference" / "pocl-epyc-2-threads"
FOCUSED = "document.activeElement"

pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed"),
    pytest.mark.skipif(
        importlib.util.find_spec("websocket") is None,
        reason="websocket-client is not installed (pip install 'gibench[browser]')",
    ),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of two committed runs, two images beside the first, and other techniques."""
    folder = tmp_path_factory.mktemp("report")
    for scene in ("cornell-box", "sponza"):
        shutil.copytree(REFERENCE / scene, folder / scene)
    images = folder / "cornell-box" / "images" / "01-srp"
    images.mkdir(parents=True)
    for name, color in (("frame", (200, 120, 40)), ("direct-only", (30, 60, 160))):
        pixels = np.full((90, 160, 3), color, np.uint8)
        Image.fromarray(pixels).save(images / f"{name}.png")
    rng, names = np.random.default_rng(0), ["one", "two"]
    kinds = [(name, variant) for name in ("gibs", "ddgi") for variant in ("tuned", "published")]
    entries = [
        entry(number, names, technique=name, variant=variant)
        for number, (name, variant) in enumerate(kinds, 1)
    ]
    times = {n: {name: rng.lognormal(n, 0.1, 50) for name in names} for n in range(1, 5)}
    write_run(folder / "others", record(*entries), times)
    runs = [str(folder / name) for name in ("cornell-box", "sponza", "others")]
    assert call(["report", *runs, "--html"]) == 0
    return folder / "cornell-box" / "report.html"


@pytest.fixture(scope="module")
def opened() -> Iterator[Browser]:
    with browser() as found:
        yield found


@pytest.fixture
def shown(opened: Browser, page: Path) -> Iterator[Browser]:
    """The page as loaded; whatever is done with it, nothing complains and nothing is fetched."""
    opened.complaints.clear()
    opened.requests.clear()
    opened.open(page.as_uri())
    yield opened
    opened.ask("1")  # what came meanwhile is read with the answer
    assert opened.complaints == []
    asked = [address for address in opened.requests if not address.startswith("data:")]
    assert asked == [page.as_uri()]


def tab_to(shown: Browser, what: str) -> None:
    """Press Tab until an element that ``what`` selects has the focus."""
    for _ in range(300):
        shown.press("Tab")
        if shown.ask(f"{FOCUSED}.matches({json.dumps(what)})"):
            return
    raise AssertionError(f"Tab never reaches {what}")


def test_headers_sort_by_enter_and_space(shown: Browser) -> None:
    tab_to(shown, "#frames th button")
    while shown.ask(f"{FOCUSED}.textContent") != "median ms":
        shown.press("Tab")
        assert shown.ask(f"{FOCUSED}.matches('#frames th button')")
    column = f"[...{FOCUSED}.closest('tr').children].indexOf({FOCUSED}.closest('th'))"
    rows = "[...document.querySelectorAll('#frames tbody tr')]"
    cells = f"{rows}.map(row => row.children[{column}].textContent)"
    sort = f"{FOCUSED}.closest('th').getAttribute('aria-sort')"
    unsorted = numbers(shown.ask(cells))
    assert len(set(unsorted)) > 3
    assert shown.ask(sort) is None
    assert shown.ask(f"getComputedStyle({FOCUSED}).outlineStyle") == "solid"
    for key, told, expected in (
        ("Enter", "ascending", sorted(unsorted)),
        ("Enter", "descending", sorted(unsorted, reverse=True)),
        ("Space", "ascending", sorted(unsorted)),
        ("Space", "descending", sorted(unsorted, reverse=True)),
    ):
        shown.press(key)
        assert shown.ask(sort) == told
        assert numbers(shown.ask(cells)) == expected
    shown.press("Tab")
    shown.press("Enter")
    assert shown.ask(sort) == "ascending"
    assert shown.ask("document.querySelectorAll('#frames [aria-sort]').length") == 1


def numbers(texts: list[str]) -> list[float]:
    return [float(text.replace(",", "")) for text in texts if text]


def test_arrow_keys_move_the_slider(shown: Browser) -> None:
    tab_to(shown, "#images input[type=range]")
    cut = "document.querySelector('#images .over').style.clipPath"
    at = f"Number({FOCUSED}.value)"
    assert shown.ask(at) == 50
    shown.press("ArrowRight", 7)
    assert shown.ask(at) == 57
    assert re.fullmatch(r"inset\(0(px)? 43% 0(px)? 0(px)?\)", shown.ask(cut))
    shown.press("ArrowLeft", 10)
    assert shown.ask(at) == 47
    assert "53%" in shown.ask(cut)
    shown.press("Home")
    assert "100%" in shown.ask(cut)


def test_selects_and_points_are_reached(shown: Browser) -> None:
    """Every point of the roofline says what it is when it has the focus."""
    tab_to(shown, "#distributions select")
    before = shown.ask("document.querySelector('#distributions .plot').textContent")
    shown.press("ArrowDown")
    assert shown.ask("document.querySelector('#distributions .plot').textContent") != before
    tab_to(shown, "#roofline svg [tabindex]")
    assert shown.ask("document.querySelector('#tip').hidden") is False
    assert "GFLOP/s" in shown.ask("document.querySelector('#tip').textContent")


def test_techniques_have_shapes_of_their_own(shown: Browser) -> None:
    shapes = shown.ask(
        "Object.fromEntries([...document.querySelectorAll('#roofline .key')].map(k =>"
        " [k.textContent, $('path', k).getAttribute('d')]))"
    )
    shapes.pop("hollow: published", None)
    assert set(shapes) == {"srp", "gibs", "ddgi"}  # direct declares no flops
    assert len(set(shapes.values())) == len(shapes)


def test_a_newcomer_finds_the_answer_and_the_samples_behind_it(shown: Browser) -> None:
    """Which one comes first; a time in it leads to its samples by Enter."""
    headings = shown.ask("[...document.querySelectorAll('main h2')].map(h => h.textContent)")
    assert headings[0] == "Which one"
    assert shown.ask("document.querySelector('nav a').textContent") == "Which one"
    top = "document.querySelector('#which .answer').getBoundingClientRect().top"
    assert shown.ask(top) < shown.ask("innerHeight")  # seen without scrolling
    assert shown.ask("document.querySelector('#which .answer').textContent").startswith(
        "On this machine ("
    )
    shown.press("Tab")
    assert shown.ask(f"{FOCUSED}.getAttribute('href')") == "#which"
    choice = "document.querySelector('#distributions select')"
    tab_to(shown, "#which td a")
    before = shown.ask(f"{choice}.value")
    while shown.ask(f"{FOCUSED}.closest('tr').rowIndex") < 2:
        shown.press("Tab")
    row = f"{FOCUSED}.closest('tr').children[0].textContent"
    technique = shown.ask(row)
    shown.press("Enter")
    assert shown.ask(f"{choice}.value") != before
    assert technique in shown.ask(f"{choice}.selectedOptions[0].textContent")
    assert shown.ask("location.hash") == "#distributions"


def test_a_pass_has_one_colour_and_no_two_in_a_legend_share_one(shown: Browser) -> None:
    legends = shown.ask(
        "[...document.querySelectorAll('.legend')].map(l => "
        "[...l.querySelectorAll('span:not(.key)')].map(s => [s.textContent, "
        "s.style.getPropertyValue('--c')]))"
    )
    bars = dict(legends[0])
    assert len(bars) > 8 and len(legends) > 2
    for legend in legends:
        own = dict(legend)
        assert len(own) == len(legend) == len(set(own.values())), own
    drawn = shown.ask(
        "[...document.querySelectorAll('#bars rect')].map(r =>"
        " [r.getAttribute('aria-label').split(':')[0], r.getAttribute('fill')])"
    )
    assert drawn and all(bars[name] == color for name, color in drawn)
    points = shown.ask(
        "[...document.querySelectorAll('#roofline svg [tabindex]')].map(g => "
        "[g.getAttribute('aria-label').split(' (')[0], $('path', g)].map(x => typeof x == 'string' "
        "? x : [x.getAttribute('fill'), x.getAttribute('stroke')]))"
    )
    assert points and all(bars[name] in drawn_with for name, drawn_with in points)
    dots = shown.ask("DATA.configurations.flatMap(c => c.passes.map(p => color(p.name)))")
    assert set(dots) == set(bars.values()) - {"var(--line)"}


def test_it_prints_on_paper(shown: Browser) -> None:
    """White paper whatever the screen; nothing cut off, nothing to be clicked."""
    media = [{"name": "prefers-color-scheme", "value": "dark"}]
    shown.tell("Emulation.setEmulatedMedia", media="print", features=media)
    style = "getComputedStyle(document.querySelector('{}')).{}"
    assert shown.ask(style.format("body", "backgroundColor")) == "rgb(255, 255, 255)"
    assert shown.ask(style.format("nav", "display")) == "none"
    assert shown.ask(style.format("#frames .table", "overflowX")) == "visible"
    assert shown.ask(style.format("#frames .table", "maxHeight")) == "none"
    printed = shown.tell("Page.printToPDF", preferCSSPageSize=True, printBackground=True)
    assert base64.b64decode(printed["data"]).startswith(b"%PDF")
    shown.tell("Emulation.setEmulatedMedia", media="", features=[])


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_colours_stand_out(shown: Browser, scheme: str, tmp_path: Path) -> None:
    """Contrast of text 4.5, of what is drawn 3 (WCAG 2.1, 1.4.3 and 1.4.11)."""
    shown.prefer(scheme)
    style = "getComputedStyle(document.documentElement).getPropertyValue('--{}').trim()"
    colors = {name: shown.ask(style.format(name)) for name in ("ground", "ink", "soft", "warn")}
    assert (luminance(colors["ground"]) < 0.05) == (scheme == "dark")
    for name in ("ink", "soft", "warn"):
        assert contrast(colors[name], colors["ground"]) >= 4.5, name
    techniques, passes = shown.ask("DATA.colors"), shown.ask("DATA.pass_colors")
    assert techniques and passes
    for name, color in (techniques | passes).items():
        assert contrast(color, colors["ground"]) >= 3, name
    background = shown.ask("getComputedStyle(document.body).backgroundColor")
    shot = tmp_path / f"{scheme}.png"
    shown.screenshot(shot)
    corner = np.asarray(Image.open(shot).convert("RGB"))[3, 3]
    assert corner.tolist() == [int(n) for n in re.findall(r"\d+", background)][:3]


def luminance(color: str) -> float:
    digits = color.removeprefix("#")
    digits = digits if len(digits) == 6 else "".join(2 * d for d in digits)
    c = np.array([int(digits[i : i + 2], 16) for i in (0, 2, 4)]) / 255
    linear = np.where(c <= 0.03928, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    high, low = sorted((luminance(a), luminance(b)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_complaints_and_requests_are_heard(opened: Browser, page: Path) -> None:
    """That they are absent says something."""
    opened.complaints.clear()
    opened.open(page.as_uri())
    opened.ask("console.error('no'); setTimeout(() => { throw Error('thrown') }, 0); 1")
    opened.ask("fetch('http://127.0.0.1:9/').catch(() => 0); 1")
    opened.ask("new Promise(done => setTimeout(done, 200))")
    opened.ask("1")
    assert any("no" in one for one in opened.complaints)
    assert any("Uncaught" in one for one in opened.complaints)
    assert "http://127.0.0.1:9/" in opened.requests
