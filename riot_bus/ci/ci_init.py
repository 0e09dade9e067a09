"""`riot ci init`: copy the workflows for GitHub and GitLab from this package."""

from __future__ import annotations

from pathlib import Path

from riot_bus.vocabulary.errors import ConfigError

_TEMPLATES = Path(__file__).parent / "templates"
WORKFLOWS = {"github": Path(".github/workflows/riot.yml"), "gitlab": Path(".gitlab-ci.riot.yml")}
"""Path of each kind of workflow in a repository."""
_SIGNS = {"github": ".github", "gitlab": ".gitlab-ci.yml"}


def init_ci(folder: Path, *, github: bool = False, gitlab: bool = False, force: bool = False) -> list[str]:
    """Write the requested workflows, or those that the repository suggests; return what was done and the next steps.

    Raises:
        ConfigError: No workflow is requested or suggested, or a file exists already or cannot be written.
    """
    asked = {"github": github, "gitlab": gitlab}
    chosen = [kind for kind, wanted in asked.items() if wanted]
    chosen = chosen or [kind for kind, sign in _SIGNS.items() if (folder / sign).exists()]
    if not chosen:
        raise ConfigError(
            "neither GitHub nor GitLab was named, and no file tells which is used",
            where=str(folder),
            hint="add --github, --gitlab, or both",
        )
    for kind in chosen:
        if (folder / WORKFLOWS[kind]).exists() and not force:
            hint = "use --force to replace it"
            raise ConfigError("a workflow exists already", where=str(folder / WORKFLOWS[kind]), hint=hint)
    return [*(f"written: {_write(kind, folder / WORKFLOWS[kind])}" for kind in chosen), *_next(folder, chosen)]


def _write(kind: str, path: Path) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text((_TEMPLATES / f"{kind}.yml").read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write the workflow: {error.strerror}", where=str(path)) from None
    return path


def _next(folder: Path, chosen: list[str]) -> list[str]:
    ignored = folder / ".gitignore"
    known = ignored.read_text(encoding="utf-8", errors="replace").splitlines() if ignored.is_file() else []
    steps = ["in the lines marked FILL IN: install riot_bus and what riot.toml starts"]
    if not (folder / "riot.toml").is_file():
        steps.append("write riot.toml: there is none here")
    if not {"riot-out", "riot-out/", "/riot-out", "/riot-out/"} & set(known):
        steps.append("add riot-out/ to .gitignore")
    if not (folder / "riot-baseline.json").is_file():
        steps.append("`riot ci batch --update --keep riot-findings`: what is found today fails no build from then on")
    if "gitlab" in chosen:
        steps.append(f"in .gitlab-ci.yml: include: {WORKFLOWS['gitlab']}; and a pipeline schedule for the night")
    steps.append("commit these files, and open a merge request")
    return [f"next, {each}" for each in steps]
