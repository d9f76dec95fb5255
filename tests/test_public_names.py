"""`import exodrake as exo`: every public name resolves for readers, completion, help() and type checkers."""

import dataclasses
import doctest
import inspect
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from report_synthetic import diagnosis

import exodrake as exo
from exodrake.data.case import gather_logs

ROOT = Path(__file__).parent.parent
CLASSES = [name for name in exo.PUBLIC if inspect.isclass(getattr(exo, name))]
RESULTS = [name for name in CLASSES if dataclasses.is_dataclass(getattr(exo, name))]


@pytest.mark.parametrize("name", exo.PUBLIC)
def test_every_public_name_resolves_and_has_a_docstring(name):
    assert getattr(exo, name).__name__ == name and getattr(exo, name).__doc__
    assert name in dir(exo) and name in exo.__all__


@pytest.mark.parametrize("name", [name for name in exo.PUBLIC if ">>> " in (getattr(exo, name).__doc__ or "")])
def test_examples_of_docstrings_run_and_print_what_they_say(name):
    found = getattr(exo, name)
    module = vars(sys.modules[found.__module__])
    test = doctest.DocTestParser().get_doctest(inspect.getdoc(found) or "", dict(module), name, None, None)
    assert doctest.DocTestRunner().run(test).failed == 0 < len(test.examples)


def test_signatures_print_plainly():
    plain = [name for name in exo.PUBLIC if name not in RESULTS and "<" in str(inspect.signature(getattr(exo, name)))]
    assert not plain, "a default has no readable value"


def test_a_robot_and_a_diagnosis_show_themselves_in_a_notebook():
    robot, found = exo.load_robot()._repr_html_(), diagnosis()._repr_html_()
    assert "326 parameters" in robot and "image/svg+xml" in robot
    assert "explains 91 % of the gap" in found and "0.270 to 0.330" in found and "image/svg+xml" in found


def test_a_diagnosis_takes_logs_and_frames():
    """The last of several is held out; the log of another robot is refused by its column."""
    pytest.importorskip("pandas")
    logs = [exo.simulate(exo.load_robot(), exo.grasp("caging", hold=0.5), seed) for seed in (1, 2)]
    for given in (logs, [log.to_pandas() for log in logs]):
        roles = [item.role for item in gather_logs(given[:1], given[1:], 0.02, ("tension_AF",)).logs]
        assert roles == ["fit", "holdout"]
    with pytest.raises(exo.InputError, match="tension_ref"):
        exo.diagnose(exo.Log(logs[0].time, {"angle_MCP": logs[0]["angle_MCP"]}))


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        exo.nothing_of_the_kind  # noqa: B018


def full(cls: type) -> object:
    """An instance whose every field is a large array, though no such instance could be made."""
    made = object.__new__(cls)
    for field in dataclasses.fields(cls):
        object.__setattr__(made, field.name, np.zeros((1000, 3)))
    return made


REAL = {
    "ClosedLoop": lambda: exo.analyse(exo.load_robot()),
    "Robot": exo.load_robot,
    "Machine": lambda: exo.load_robot().machine,
    "Log": lambda: exo.Log(np.arange(9.0), {f"angle_{k}": np.zeros(9) for k in range(99)}),
}


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_has_a_repr_of_at_most_two_lines(name):
    written = repr(REAL[name]() if name in REAL else full(getattr(exo, name)))
    assert len(written.splitlines()) <= 2 and len(written) <= 240 and name in written


def test_results_with_arrays_are_among_those_tested():
    assert {"Robot", "Machine", "Log", "Case", "Diagnosis", "Reference", "Recording", "ClosedLoop"} <= set(RESULTS)


KINDS = {"Robot", "Reference", "Log", "Case", "Machine", "Diagram", "Context", "Plan", "Requirements"}


def doors():
    """Public functions, each with its parameters that take one of the classes above."""
    for name in exo.PUBLIC:
        for parameter in inspect.signature(getattr(exo, name)).parameters.values() if name not in CLASSES else ():
            kinds = str(getattr(parameter.annotation, "__name__", parameter.annotation)).split(" | ")
            if KINDS & set(kinds):
                yield name, parameter.name, kinds


@pytest.fixture(scope="module")
def whole():
    """An argument of each name that the public functions accept."""
    robot, reference = exo.load_robot(), exo.sweeps()
    diagram, log = exo.build_diagram(robot, reference), exo.Log(np.arange(9.0), {"angle_MCP": np.zeros(9)})
    return {
        "robot": robot, "reference": reference, "log": log, "first": log, "second": log, "machine": robot.machine,
        "diagram": diagram, "context": diagram.CreateDefaultContext(), "path": "absent.csv", "folder": "absent",
        "mode": "caging", "size": 0.05, "text": "caging", "name": "tendon.k.AF", "case": "absent",
        "plan": exo.plan_grasp("caging", 0.06), "builder": DiagramBuilder(),
        "input": "angle_MCP", "output": "angle_MCP", "logs": log, "free": ["finger.kappa"], "over": 2,
    }  # fmt: skip


@pytest.mark.parametrize("wrong", [17, [1.0]], ids=["int", "list"])
@pytest.mark.parametrize(("name", "parameter", "kinds"), list(doors()))
def test_an_argument_of_a_wrong_type_is_named_with_what_is_wanted(whole, name, parameter, kinds, wrong):
    function = getattr(exo, name)
    needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    given = {key: whole[key] for key in needed if key in whole} | {parameter: wrong}
    wanted = " or ".join(kinds)
    with pytest.raises(TypeError, match=rf"^{parameter}: wanted {wanted}, got {type(wrong).__name__} \("):
        function(**given)


def test_the_doors_tested_are_those_of_a_reader():
    found = {(name, parameter) for name, parameter, _ in doors()}
    assert {("simulate", "robot"), ("simulate", "reference"), ("diagnose", "case"), ("regularise", "log")} <= found
    assert {("find_parameter", "diagram"), ("diagram_log", "context"), ("grasp", "robot")} <= found


def test_a_type_checker_sees_every_public_name(tmp_path):
    uses = [f"exo.{name}" for name in exo.PUBLIC]
    (tmp_path / "uses.py").write_text("\n".join(["import exodrake as exo", *uses, "exo.nonsense"]) + "\n")
    command = [sys.executable, "-m", "pyright", "--outputjson", str(tmp_path / "uses.py")]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    found = [item["message"] for item in json.loads(run.stdout)["generalDiagnostics"] if item["severity"] == "error"]
    assert (ROOT / "exodrake" / "py.typed").is_file() and len(found) == 1 and "nonsense" in found[0]
