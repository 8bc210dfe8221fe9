"""Descriptions of an FMU as XML: the model of FMI 2.0 and of FMI 3.0, and how its sources are built."""

from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from fmd.output.fmu.variables import FmuVariable, Interface, units_of


class Heading(NamedTuple):
    """Names, version and times of a model, which head its description."""

    name: str
    identifier: str
    token: str
    title: str
    version: str
    duration: float
    output_step: float
    sources: tuple[str, ...]


def describe_fmi2(heading: Heading, interface: Interface) -> bytes:
    """Write ``modelDescription.xml`` of FMI 2.0."""
    root = _root("2.0", heading, guid=heading.token, numberOfEventIndicators="0")
    for kind in _add_ways(root, heading, "canGetAndSetFMUstate", "canSerializeFMUstate", "DirectionalDerivative"):
        files = SubElement(kind, "SourceFiles")
        for name in heading.sources:
            SubElement(files, "File", name=name)
    variables = _add_variables(root, heading, interface)
    for own in interface.variables:
        entry = SubElement(variables, "ScalarVariable", _name(own))
        _say(entry, own)
        SubElement(entry, "Real", _common(own))
    structure = SubElement(root, "ModelStructure")
    outputs = interface.of("output")
    _add_unknowns(structure, "Outputs", outputs)
    _add_unknowns(structure, "Derivatives", interface.derivatives)
    unknowns = sorted([*outputs, *interface.derivatives], key=lambda own: own.reference)
    _add_unknowns(structure, "InitialUnknowns", [own._replace(depends=None) for own in unknowns])
    return _bytes(root)


def _add_unknowns(structure: Element, kind: str, members: list[FmuVariable]) -> None:
    group = SubElement(structure, kind) if members else structure
    for own in members:
        _add_unknown(group, "Unknown", "index", own)


def describe_fmi3(heading: Heading, interface: Interface) -> bytes:
    """Write ``modelDescription.xml`` of FMI 3.0."""
    root = _root("3.0", heading, instantiationToken=heading.token)
    _add_ways(root, heading, "canGetAndSetFMUState", "canSerializeFMUState", "DirectionalDerivatives")
    variables = _add_variables(root, heading, interface)
    clock = {"causality": "independent", "variability": "continuous", "description": "time", "unit": "s"}
    SubElement(variables, "Float64", {"name": "time", "valueReference": "0"} | clock)
    for own in interface.variables:
        _say(SubElement(variables, "Float64", _name(own) | _common(own)), own)
    structure = SubElement(root, "ModelStructure")
    outputs = interface.of("output")
    for kind, members in (("Output", outputs), ("ContinuousStateDerivative", interface.derivatives)):
        for own in members:
            _add_unknown(structure, kind, "valueReference", own)
    for own in [*outputs, *interface.derivatives]:
        SubElement(structure, "InitialUnknown", valueReference=str(own.reference))
    return _bytes(root)


def describe_build(heading: Heading) -> bytes:
    """Write ``buildDescription.xml`` of FMI 3.0: which sources make the binary."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    build = SubElement(root, "BuildConfiguration", modelIdentifier=heading.identifier)
    files = SubElement(build, "SourceFileSet", language="C99")
    for name in heading.sources:
        SubElement(files, "SourceFile", name=name)
    return _bytes(root)


def _root(version: str, heading: Heading, **more: str) -> Element:
    named = {"fmiVersion": version, "modelName": heading.name, "description": heading.title}
    made = {"generationTool": f"fmd {heading.version}", "variableNamingConvention": "structured"}
    return Element("fmiModelDescription", named | made | more)


def _add_ways(root: Element, heading: Heading, *abilities: str) -> tuple[Element, Element]:
    """Add model exchange and co-simulation, with what both can do."""
    *states, derivatives = abilities
    able = dict.fromkeys((*states, f"provides{derivatives}"), "true") | {"modelIdentifier": heading.identifier}
    simulation = able | {"canHandleVariableCommunicationStepSize": "true"}
    return SubElement(root, "ModelExchange", able), SubElement(root, "CoSimulation", simulation)


def _add_variables(root: Element, heading: Heading, interface: Interface) -> Element:
    """Add units, categories of the log and the experiment; return the element of the variables, which come next."""
    _add_units(root, interface)
    _add_log_categories(root)
    _add_experiment(root, heading)
    return SubElement(root, "ModelVariables")


def _add_unknown(group: Element, kind: str, key: str, own: FmuVariable) -> None:
    unknown = SubElement(group, kind, {key: str(own.reference)})
    if own.depends is not None:
        unknown.set("dependencies", " ".join(map(str, own.depends)))


def _name(own: FmuVariable) -> dict[str, str]:
    found = {"name": own.name, "valueReference": str(own.reference)}
    found |= {"causality": own.causality, "variability": own.variability}
    return found | ({"initial": own.initial} if own.initial else {})


def _common(own: FmuVariable) -> dict[str, str]:
    found = {"unit": own.unit} if own.unit else {}
    found |= {"start": repr(own.start)} if own.start is not None else {}
    found |= {"nominal": repr(own.nominal)} if own.nominal != 1.0 else {}
    return found | ({"derivative": str(own.state)} if own.state is not None else {})


def _say(entry: Element, own: FmuVariable) -> None:
    if own.description:
        entry.set("description", own.description)


def _add_units(root: Element, interface: Interface) -> None:
    units = SubElement(root, "UnitDefinitions")
    for name, exponents in units_of(interface.variables):
        unit = SubElement(units, "Unit", name=name)
        SubElement(unit, "BaseUnit", {base: str(power) for base, power in exponents.items()})


def _add_log_categories(root: Element) -> None:
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError")


def _add_experiment(root: Element, heading: Heading) -> None:
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0.0",
        stopTime=repr(heading.duration),
        stepSize=repr(heading.output_step),
    )


def _bytes(root: Element) -> bytes:
    indent(root)
    body: bytes = tostring(root, encoding="utf-8")
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + body + b"\n"
