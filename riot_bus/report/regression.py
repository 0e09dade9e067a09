"""The files of a finding that run it again: a shell script, and a test for pytest.

The test fails as long as the unit does, and passes once the unit is fixed.
"""

from __future__ import annotations

import re
from pathlib import Path

from riot_bus.findings.records import FindingRecord
from riot_bus.new_file import write_whole
from riot_bus.report.format import clean
from riot_bus.report.formats import write_file

_SCRIPT = """\
#!/bin/sh
exec riot reproduce "$(cd -- "$(dirname -- "$0")" && pwd)" "$@"
"""

_TEXT = '''\
"""{component} {what}.

riot found this failure; the finding is the folder of this file. The test plays the shortest failing log there to
fresh processes of {component}, as `riot reproduce` does: it fails as long as the failure occurs, and passes once
it is fixed.

    pytest PATH/{name}

It needs only riot_bus and the component that it tests, which the riot.toml of the working folder describes, or the
one that RIOT_SYSTEM names. To use it in a test suite, copy the whole folder there and rename this file to
test_{stem}.py.
"""

from pathlib import Path

from riot_bus.testing.regression import reproduce_finding

FINDING = Path(__file__).resolve().parent

SIGNATURE = {signature}


def test_{function}():
    found = reproduce_finding(FINDING)
    assert found.answer == "fixed", (
        f"{{found.failed}} of {{found.trials}} trials of {{found.log}} fail: {{SIGNATURE}}: {{found.detail}}"
    )
'''


def write_reproduce(directory: Path) -> Path:
    """Write `reproduce.sh`, which runs `riot reproduce` on the directory that it lies in, wherever that was moved."""
    path = directory / "reproduce.sh"
    write_whole(path, _SCRIPT, mode=0o755)
    return path


def regression_name(finding: FindingRecord) -> str:
    """Return the name of the file; pytest does not collect it unless it is named, since it fails today."""
    return f"riot_test_{file_stem(finding)}.py"


def write_regression_test(directory: Path, finding: FindingRecord) -> Path:
    """Write the test into the directory of a finding."""
    text = _TEXT.format(
        component=_plain(finding.component),
        what=f"fails ({_plain(finding.monitor)}) on a log of riot's",
        name=regression_name(finding),
        stem=file_stem(finding),
        signature=ascii(finding.signature),
        function=file_stem(finding),
    )
    return write_file(text, directory / regression_name(finding))


def file_stem(finding: FindingRecord) -> str:
    """Return the finding's id in a form for the names of files and functions."""
    return re.sub(r"[^A-Za-z0-9]+", "_", finding.id)[:100].strip("_") or "finding"


def _plain(text: str) -> str:
    """Return text that can stand in a docstring."""
    return clean(text, limit=60).replace("\\", "/").replace('"', "'")
