"""What type checkers and editors are told is what there is."""

import ast
import inspect
import pathlib
import re

import mujoco
import pytest
from conftest import GRIPPER, in_another_process

import mujoco_grasp as mg
from mujoco_grasp import _core, errors

PACKAGE = pathlib.Path(mg.__file__).parent
# of what Python gives every class
DUNDERS = {"__eq__", "__hash__", "__iter__", "__getitem__", "__len__", "__copy__", "__deepcopy__"}

STUB = ast.parse((PACKAGE / "_core.pyi").read_text())
CLASSES = {node.name: node for node in STUB.body if isinstance(node, ast.ClassDef) and not node.name.startswith("_")}
FUNCTIONS = {node.name: node for node in STUB.body if isinstance(node, ast.FunctionDef)}


def methods(node):
    return {item.name: item for item in node.body if isinstance(item, ast.FunctionDef)}


def parameters(node):
    """Names, kinds and defaults by the stub, without self or cls."""
    args = node.args
    positional = [*args.posonlyargs, *args.args]
    defaults = [inspect.Parameter.empty] * (len(positional) - len(args.defaults)) + [ast.literal_eval(d) for d in args.defaults]
    listed = [(arg.arg, "positional", default) for arg, default in zip(positional, defaults, strict=True)]
    if listed and listed[0][0] in ("self", "cls"):
        del listed[0]
    for arg, default in zip(args.kwonlyargs, args.kw_defaults, strict=True):
        listed.append((arg.arg, "keyword", inspect.Parameter.empty if default is None else ast.literal_eval(default)))
    return listed + ([(args.kwarg.arg, "any", inspect.Parameter.empty)] if args.kwarg else [])


def real_parameters(function):
    kinds = {inspect.Parameter.KEYWORD_ONLY: "keyword", inspect.Parameter.VAR_KEYWORD: "any"}
    listed = inspect.signature(function).parameters.values()
    return [(p.name, kinds.get(p.kind, "positional"), p.default) for p in listed if p.name != "self"]


def test_the_stub_has_what_the_core_has():
    own = {name for name in vars(_core) if not name.startswith("_")}
    assert own == set(CLASSES) | set(FUNCTIONS)
    for name, node in CLASSES.items():
        real, told = getattr(_core, name), methods(node)
        public = {item for item in vars(real) if not item.startswith("_")}
        assert public == {item for item in told if not item.startswith("_")}, name
        unhashable = {"__hash__"} if real.__hash__ is None else set()
        assert DUNDERS & set(vars(real)) - unhashable == {item for item in told if item in DUNDERS}, name


@pytest.mark.parametrize("name", [*CLASSES, *FUNCTIONS])
def test_signatures_and_docstrings_are_those_of_the_stub(name):
    if name in FUNCTIONS:
        assert real_parameters(getattr(_core, name)) == parameters(FUNCTIONS[name])
        return
    real, told = getattr(_core, name), methods(CLASSES[name])
    first = ast.get_docstring(CLASSES[name]).split("\n")[0]
    assert real.__doc__.split(":")[0].split("\n")[0].rstrip(".") == first.split(":")[0].rstrip(".")
    if "__new__" in told:
        assert real_parameters(real) == parameters(told["__new__"])
    for item, node in told.items():
        if item.startswith("_"):
            continue
        member = vars(real)[item]
        assert inspect.getdoc(member), f"{name}.{item} has no docstring"
        is_property = any(ast.unparse(decorator) == "property" for decorator in node.decorator_list)
        assert is_property == inspect.isgetsetdescriptor(member) or "setter" in ast.unparse(node.decorator_list[0])
        if not inspect.isgetsetdescriptor(member):
            assert real_parameters(getattr(real, item)) == parameters(node), f"{name}.{item}"


def test_help_has_all_options_with_their_units():
    options = next(node for node in STUB.body if getattr(node, "name", "") == "_GraspOptions")
    names = [item.target.id for item in options.body if isinstance(item, ast.AnnAssign)]
    assert len(names) == 12
    for name in ["model", "data", "target", "palm", "frozen_tolerance", *names]:
        assert f"\n    {name}: " in inspect.getdoc(mg.Grasps), name
    model = mujoco.MjModel.from_xml_path(str(GRIPPER))
    grasps = mg.Grasps(model, mujoco.MjData(model), "ball", **dict.fromkeys(names))
    assert grasps.frozen_tolerance == 2e-3, "None is an option's default"


def test_all_that_is_public_is_said():
    assert set(errors.__all__) <= set(mg.__all__)
    assert sorted(mg.__all__, key=lambda name: (name[0].islower(), name)) == mg.__all__
    assert all(hasattr(mg, name) for name in mg.__all__)
    tree = ast.parse((PACKAGE / "__init__.py").read_text())
    said = next(node.value for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == "__all__")
    assert ast.literal_eval(said) == mg.__all__, "a checker can read it"


def test_a_type_checker_knows_the_core(tmp_path):
    pytest.importorskip("mypy")
    program = tmp_path / "program.py"
    program.write_text(
        "import mujoco_grasp as mg\n"
        "def f(grasps: mg.Grasps, batch: mg.Batch) -> None:\n"
        "    reveal_type(grasps[0].contacts()[0].normal_force)\n"
        "    reveal_type([grasp.phase for grasp in grasps])\n"
        "    reveal_type(batch.grasps)\n"
        "    reveal_type(mg.State.from_json('').to_json())\n"
        "    reveal_type(mg.SpecError('').failed)\n"
        "    grasps.sep(3)\n"
    )
    out = in_another_process(
        f"from mypy import api\nprint(api.run(['--strict', '--cache-dir', {str(tmp_path / 'cache')!r}, {str(program)!r}])[0])"
    )
    shown = [text.replace("builtins.", "") for text in re.findall(r'Revealed type is "(.*)"', out)]
    assert shown[0] == "float"
    assert "'ungrasped'" in shown[1]
    assert shown[2] == "tuple[mujoco_grasp._core.Grasps, ...]"
    assert shown[3:] == ["str", "tuple[int, ...]"]
    assert 'program.py:8: error: "Grasps" has no attribute "sep"' in out
    assert "Found 1 error" in out
