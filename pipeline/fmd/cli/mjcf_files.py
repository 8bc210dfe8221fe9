"""Files of an MJCF model, one included in the other, and errors that name what is at fault in them."""

from pathlib import Path
from xml.etree import ElementTree

from fmd.cli.robot import naming, read_robot_xml, read_xml
from fmd.core.errors import InputError


def read_model(path: Path) -> ElementTree.Element:
    """Return the first element of an MJCF file, with included files in their places; raises ``InputError``."""
    top = read_robot_xml(path, "mujoco", "MJCF")
    with naming(path, ""):
        _include(top, path, path, {path.resolve()})
    return top


def _include(top: ElementTree.Element, path: Path, within: Path, read: set[Path]) -> None:
    """Put the elements of included files, whose first element is any, in their places.

    Their names are from the folder of the model, or else of the file that includes them; none is read twice.
    """
    for parent in [*top.iter()]:
        for place, element in reversed([*enumerate(parent)]):
            if element.tag == "include":
                parent.remove(element)
                name = element.attrib["file"]
                file = path.parent / name if (path.parent / name).is_file() else within.parent / name
                if file.resolve() in read:
                    raise InputError(str(within), "include", name, "is included twice, or in itself")
                read.add(file.resolve())
                other = read_xml(file)
                _include(other, path, file, read)
                for child in reversed(other):
                    parent.insert(place, child)
