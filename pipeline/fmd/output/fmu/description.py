"""Descriptions of an FMU as XML: the model of FMI 2.0 and of FMI 3.0, and how its sources are built."""

from __future__ import annotations

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
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=heading.name,
        guid=heading.token,
        description=heading.title,
        generationTool=f"fmd {heading.version}",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
    abilities = {
        "modelIdentifier": heading.identifier,
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "providesDirectionalDerivative": "true",
    }
    exchange = SubElement(root, "ModelExchange", abilities)
    simulation = SubElement(root, "CoSimulation", abilities, canHandleVariableCommunicationStepSize="true")
    for kind in (exchange, simulation):
        files = SubElement(kind, "SourceFiles")
        for name in heading.sources:
            SubElement(files, "File", name=name)
    _add_units(root, interface)
    _add_log_categories(root)
    _add_experiment(root, heading)
    variables = SubElement(root, "ModelVariables")
    for own in interface.variables:
        causes = {"causality": own.causality, "variability": own.variability}
        causes |= {"initial": own.initial} if own.initial else {}
        entry = SubElement(
            variables, "ScalarVariable", {"name": own.name, "valueReference": str(own.reference)} | causes
        )
        _say(entry, own)
        real = SubElement(entry, "Real", _common(own))
        if own.state is not None:
            real.set("derivative", str(own.state))
    structure = SubElement(root, "ModelStructure")
    outputs = interface.of("output")
    _add_unknowns(structure, "Outputs", outputs)
    _add_unknowns(structure, "Derivatives", interface.derivatives)
    unknowns = sorted([*outputs, *interface.derivatives], key=lambda own: own.reference)
    _add_unknowns(structure, "InitialUnknowns", [own._replace(depends=None) for own in unknowns])
    return _bytes(root)


def _add_unknowns(structure: Element, kind: str, members: list[FmuVariable]) -> None:
    if not members:
        return
    group = SubElement(structure, kind)
    for own in members:
        unknown = SubElement(group, "Unknown", index=str(own.reference))
        if own.depends is not None:
            unknown.set("dependencies", " ".join(map(str, own.depends)))


def describe_fmi3(heading: Heading, interface: Interface) -> bytes:
    """Write ``modelDescription.xml`` of FMI 3.0."""
    root = Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=heading.name,
        instantiationToken=heading.token,
        description=heading.title,
        generationTool=f"fmd {heading.version}",
        variableNamingConvention="structured",
    )
    abilities = {
        "modelIdentifier": heading.identifier,
        "canGetAndSetFMUState": "true",
        "canSerializeFMUState": "true",
        "providesDirectionalDerivatives": "true",
    }
    SubElement(root, "ModelExchange", abilities)
    SubElement(root, "CoSimulation", abilities, canHandleVariableCommunicationStepSize="true")
    _add_units(root, interface)
    _add_log_categories(root)
    _add_experiment(root, heading)
    variables = SubElement(root, "ModelVariables")
    clock = {"causality": "independent", "variability": "continuous", "description": "time", "unit": "s"}
    SubElement(variables, "Float64", {"name": "time", "valueReference": "0"} | clock)
    for own in interface.variables:
        causes = {"causality": own.causality, "variability": own.variability}
        causes |= {"initial": own.initial} if own.initial else {}
        entry = SubElement(variables, "Float64", {"name": own.name, "valueReference": str(own.reference)} | causes)
        _say(entry, own)
        for key, value in _common(own).items():
            entry.set(key, value)
        if own.state is not None:
            entry.set("derivative", str(own.state))
    structure = SubElement(root, "ModelStructure")
    outputs = interface.of("output")
    for kind, members in (("Output", outputs), ("ContinuousStateDerivative", interface.derivatives)):
        for own in members:
            unknown = SubElement(structure, kind, valueReference=str(own.reference))
            if own.depends is not None:
                unknown.set("dependencies", " ".join(map(str, own.depends)))
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


def _common(own: FmuVariable) -> dict[str, str]:
    found = {"unit": own.unit} if own.unit else {}
    found |= {"start": repr(own.start)} if own.start is not None else {}
    return found | ({"nominal": repr(own.nominal)} if own.nominal != 1.0 else {})


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
