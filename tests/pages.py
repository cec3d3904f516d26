"""Blocks of the pages of the documentation, and the commands that stand in them."""

import re
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent / "docs"
_FENCE = re.compile(
    r"^(?P<fence>`{3,})(?P<language>[^\n`]*)\n(?P<body>.*?)^(?P=fence)$", re.DOTALL | re.MULTILINE
)
_COMMAND = re.compile(r"^\s*(?:\$ )?(symid .*)$", re.MULTILINE)
_PROGRAM = re.compile(r"^\s*(?:\$ )?(?:symid|cc|make|cmake) ", re.MULTILINE)
_CODE = {"c", "cmake", "python", "sql", "toml"}
"""Languages of blocks that are to run, compile or be read, whatever stands in them."""


@dataclass(frozen=True)
class Block:
    """A block of a page: what stands between its fences, and where."""

    page: str
    line: int
    language: str
    body: str

    @property
    def commands(self) -> tuple[str, ...]:
        """Return its commands of symid, those of several lines as one."""
        return tuple(_COMMAND.findall(re.sub(r"\\\n\s*", "", self.body)))

    @property
    def runs(self) -> bool:
        """Return whether there is something to run, to compile or to read."""
        tables = not self.language and self.body.startswith("[")
        return self.language in _CODE or tables or bool(_PROGRAM.search(self.body))


def list_blocks(page: str) -> list[Block]:
    """Return the blocks of a page, by its name below the folder of the documentation."""
    text = (DOCS / page).read_text(encoding="utf-8")
    return [
        Block(page, text.count("\n", 0, found.start()) + 1, found["language"], found["body"])
        for found in _FENCE.finditer(text)
    ]


def list_pages() -> list[str]:
    """Return the names of all pages."""
    return sorted(str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md"))


class PageReader(HTMLParser):
    """Tags, links and anchors of a page, and tags that are not closed."""

    VOID = ("br", "meta", "link", "img", "hr")

    def __init__(self, text):
        super().__init__()
        self.tags, self.links, self.anchors, self.open, self.wrong = [], [], [], [], []
        self.feed(text)
        self.close()

    @property
    def loaded(self):
        """Return links to elsewhere."""
        return [link for link in self.links if link[0] != "#"]

    def handle_starttag(self, tag, attrs):
        self.handle_startendtag(tag, attrs)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href")]
        self.anchors += [value for name, value in attrs if name == "id"]

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)


EMBEDDED = "tests/embedded/test_boards.py"
EXAMPLES, TRANSCRIPTS = "tests/docs/test_examples.py", "tests/docs/test_transcripts.py"
BUILT = "tests/cli/test_c_library_page.py"
READ = "tests/unit/robot/test_documents.py"
ELSEWHERE = {
    # (page, what is found in the command, else in the block): where it runs
    ("api/index.md", ""): "tests/docs/test_api_scripts.py",
    ("api/optimal_control.md", ""): "tests/docs/test_api_scripts.py",
    ("api/scripts.md", ""): "tests/docs/test_api_scripts.py",
    ("bad_wrist.md", ""): TRANSCRIPTS,
    ("c_library.md", "int main"): BUILT,
    ("c_library.md", "cmake_minimum"): BUILT,
    ("c_library.md", "^cc "): BUILT,
    ("c_library.md", "bristles"): BUILT,
    ("command_line.md", "--tracking --against"): "tests/cli/test_elastic_verbs.py",
    ("compare.md", "^symid compare tx40"): "tests/golden/test_tx40.py",
    ("course.md", "sheet"): "tests/unit/lessons/test_exercises.py",
    ("diagnosis.md", "tx40"): "tests/golden/test_tx40.py",
    ("diagnosis.md", "^symid report kr300.json"): "tests/golden/test_kr300.py",
    ("elastic.md", "^import symid"): TRANSCRIPTS,
    ("elastic.md", "symid.joint_models"): EXAMPLES,
    ("embedded.md", "^make test-embedded"): EMBEDDED,
    ("excite.md", ""): "tests/cli/test_excite.py",
    ("export.md", "two_link|welder"): "tests/cli/test_export_page.py",
    ("first_code.md", ""): TRANSCRIPTS,
    ("first_fit.md", ""): TRANSCRIPTS,
    ("first_lecture.md", ""): TRANSCRIPTS,
    ("fleet.md", "^(SELECT|WITH)"): "tests/unit/fleet/test_view.py",
    ("friction_dynamic.md", "symid.joint_models|symid.simulation|symid.codegen"): EXAMPLES,
    ("gravity.md", ""): TRANSCRIPTS,
    ("friction_tables.md", "^symid study friction-tables -o"): "tests/cli/test_friction_study.py",
    ("gallery.md", ""): EXAMPLES,
    ("hysteresis.md", ""): TRANSCRIPTS,
    ("index.md", ""): "tests/docs/test_first_screen.py",
    ("lessons.md", "--ipynb"): "tests/unit/lessons/test_notebook.py",
    ("logs.md", "run.db3"): "tests/cli/test_bags.py",
    ("own_robot.md", ""): "tests/cli/test_own_robot_page.py",
    ("robot_file.md", "^(name|.log|.controller|.processing|.settings)"): READ,
    ("robot_file.md", "lugre"): READ,
    ("robots.md", "^symid identify ur10"): "tests/golden/test_bags.py",
    ("round_trip.md", ""): TRANSCRIPTS,
    ("short_log.md", ""): TRANSCRIPTS,
    ("urdf.md", "import"): READ,
}


def find_elsewhere(page, text):
    """Return the test that runs a command or a block, None where there is none."""
    own = ((pattern, test) for (name, pattern), test in ELSEWHERE.items() if name == page)
    return next((test for pattern, test in own if re.search(pattern, text, re.MULTILINE)), None)
