"""The papers of the house: they agree with each other, and what they name is there."""

import re
import subprocess
import sys
import tomllib

import pytest
import yaml
from helpers.data import ROOT

FORMS = sorted(path for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml") if path.stem != "config")
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


def toml(name):
    return tomllib.loads((ROOT / name).read_text(encoding="utf-8"))


def test_versions_and_licences_are_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    project, workspace = toml("pyproject.toml")["project"], toml("Cargo.toml")["workspace"]["package"]
    assert citation["version"] == project["version"] == workspace["version"]
    assert " OR ".join(citation["license"]) == project["license"] == workspace["license"]
    assert citation["repository-code"] == workspace["repository"]


@pytest.mark.parametrize("form", FORMS, ids=lambda path: path.stem)
def test_issue_forms_ask_for_what_inspect_says(form):
    fields = {field.get("id"): field for field in yaml.safe_load(form.read_text(encoding="utf-8"))["body"]}
    assert "dynid inspect --json" in fields["inspect"]["attributes"]["description"]
    if form.stem != "wish":
        assert fields["inspect"]["validations"]["required"] is True


@pytest.mark.parametrize("schema", ["citation-file-format", "github-workflows", "github-issue-forms"])
def test_the_schemas_refuse_what_is_wrong(schema, tmp_path):
    """`make check` believes them."""
    good = {"citation-file-format": ROOT / "CITATION.cff", "github-workflows": WORKFLOWS[0]}.get(schema, FORMS[0])
    text = good.read_text(encoding="utf-8")
    wrong = {"citation-file-format": "authors:", "github-workflows": "jobs:"}.get(schema, "body:")
    path = tmp_path / "file.yml"
    codes = []
    for content in (text, text.replace(wrong, f"x_{wrong}", 1)):
        path.write_text(content, encoding="utf-8")
        command = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", f"vendor.{schema}", str(path)]
        codes.append(subprocess.run(command, capture_output=True, check=False).returncode)
    assert codes == [0, 1]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_actions_are_pinned_by_commit_and_say_their_version(workflow):
    used = re.findall(r"uses: (\S+)(.*)", workflow.read_text(encoding="utf-8"))
    for action, comment in used:
        if not action.startswith("./"):
            assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}", action), action
            assert re.fullmatch(r" # v\d+\.\d+\.\d+", comment), action


def test_what_workflows_and_the_page_for_contributors_call_is_there():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    texts = [page, *(path.read_text(encoding="utf-8") for path in WORKFLOWS)]
    called = {name for text in texts for name in re.findall(r"(?:`|run: |^)make ([a-z-]+)", text, re.MULTILINE)}
    assert called
    assert called <= targets
    named = re.findall(r"`((?:rust|python|tests|docs|\.ci|\.github)/[\w./-]*\w)`", page)
    assert len(named) > 8
    assert [name for name in named if not (ROOT / name).exists()] == []


def test_no_two_files_of_tests_have_one_name():
    """One process of pytest refuses the second of them; which files share one depends on the cores."""
    names = [path.name for path in (ROOT / "tests").rglob("test_*.py")]
    assert sorted(names) == sorted(set(names))
