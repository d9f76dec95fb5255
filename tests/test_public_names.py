"""`import exodrake as exo`: every public name resolves for readers, completion, help() and type checkers."""

import dataclasses
import doctest
import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder
from report_synthetic import diagnosis

import exodrake as exo
from exodrake.analysis.tuning import Tuned
from exodrake.data.case import gather_logs

ROOT = Path(__file__).parent.parent
CLASSES = [name for name in exo.PUBLIC if inspect.isclass(getattr(exo, name))]
RESULTS = [name for name in CLASSES if dataclasses.is_dataclass(getattr(exo, name))]


def test_every_public_name_resolves_and_has_a_docstring_and_a_plain_signature():
    for name in exo.PUBLIC:
        assert getattr(exo, name).__name__ == name and getattr(exo, name).__doc__
        assert name in dir(exo) and name in exo.__all__
        assert "<" not in str(inspect.signature(getattr(exo, name))), name
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        exo.nothing_of_the_kind  # noqa: B018


@pytest.mark.parametrize("name", exo.__all__)
def test_every_public_name_has_examples_that_run_and_print_what_they_say(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("EXODRAKE_PLUGINS", os.environ.get("EXODRAKE_PLUGINS", ""))
    found = getattr(exo, name)
    module = vars(sys.modules[found.__module__])
    test = doctest.DocTestParser().get_doctest(inspect.getdoc(found) or "", dict(module), name, None, None)
    assert doctest.DocTestRunner().run(test).failed == 0 < len(test.examples)


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


def full(cls: type) -> object:
    """An instance whose every field is a large array, though no such instance could be made."""
    made = object.__new__(cls)
    for field in dataclasses.fields(cls):
        object.__setattr__(made, field.name, np.zeros((1000, 3)))
    return made


def test_every_result_has_a_repr_of_at_most_two_lines():
    log = exo.Log(np.arange(9.0), {f"angle_{k}": np.zeros(9) for k in range(99)})
    real = {
        "Robot": exo.load_robot(), "Machine": exo.load_robot().machine,
        "ClosedLoop": exo.analyse(exo.load_robot("emps")), "Diagnosis": diagnosis(),
        "Log": log, "Comparison": exo.compare(log, log),
        "Tuning": exo.Tuning(exo.load_robot(), exo.Requirements(), (tuned(),)),
    }  # fmt: skip
    assert "NAMED" in repr(diagnosis()) and repr(diagnosis()).endswith("explains 91 % of the gap; 6 % remains.")
    assert {*real, "Case", "Reference", "Recording"} <= set(RESULTS)
    for name in RESULTS:
        written = repr(real[name] if name in real else full(getattr(exo, name)))
        assert len(written.splitlines()) <= 2 and len(written) <= 240 and name in written


def tuned() -> Tuned:
    """A controller with four gains that holds all requirements."""
    gains = {f"controller.gain_{k}.AF": 1.0 / 3.0 for k in range(4)}
    return Tuned("PI, filtered", exo.load_robot(), gains, (), (), 1.0, 0.05, 0.7, 1.0, ())


KINDS = {"Robot", "Reference", "Log", "Case", "Machine", "Diagram", "Context", "Plan", "Requirements"}


def doors():
    """Public functions, each with its parameters that take one of the classes above."""
    for name in exo.PUBLIC:
        for parameter in inspect.signature(getattr(exo, name)).parameters.values() if name not in CLASSES else ():
            kinds = str(getattr(parameter.annotation, "__name__", parameter.annotation)).split(" | ")
            if KINDS & set(kinds):
                yield name, parameter.name, kinds


def test_an_argument_of_a_wrong_type_is_named_with_what_is_wanted():
    robot, reference = exo.load_robot(), exo.sweeps()
    diagram, log = exo.build_diagram(robot, reference), exo.Log(np.arange(9.0), {"angle_MCP": np.zeros(9)})
    whole = {
        "robot": robot, "reference": reference, "log": log, "first": log, "second": log, "machine": robot.machine,
        "diagram": diagram, "context": diagram.CreateDefaultContext(), "path": "absent.csv", "folder": "absent",
        "mode": "caging", "size": 0.05, "text": "caging", "name": "tendon.k.AF", "case": "absent",
        "plan": exo.plan_grasp("caging", 0.06), "builder": DiagramBuilder(),
        "input": "angle_MCP", "output": "angle_MCP", "logs": log, "free": ["finger.kappa"], "over": 2,
    }  # fmt: skip
    found = list(doors())
    assert {("simulate", "robot"), ("simulate", "reference"), ("diagnose", "case"), ("regularise", "log"),
            ("find_parameter", "diagram"), ("diagram_log", "context")} <= {one[:2] for one in found}  # fmt: skip
    for name, parameter, kinds in found:
        function = getattr(exo, name)
        needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
        for wrong in (17, [1.0]):
            given = {key: whole[key] for key in needed if key in whole} | {parameter: wrong}
            said = rf"^{parameter}: wanted {' or '.join(kinds)}, got {type(wrong).__name__} \("
            with pytest.raises(TypeError, match=said):
                function(**given)


def test_a_type_checker_sees_every_public_name(tmp_path):
    uses = [f"exo.{name}" for name in exo.PUBLIC]
    (tmp_path / "uses.py").write_text("\n".join(["import exodrake as exo", *uses, "exo.nonsense"]) + "\n")
    command = [sys.executable, "-m", "pyright", "--outputjson", str(tmp_path / "uses.py")]
    run = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    found = [item["message"] for item in json.loads(run.stdout)["generalDiagnostics"] if item["severity"] == "error"]
    assert (ROOT / "exodrake" / "py.typed").is_file() and len(found) == 1 and "nonsense" in found[0]
