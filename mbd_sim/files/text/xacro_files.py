"""Xacro files, which are programs that write a URDF: what they write, with the place of each element in its file.

ROS's own `xacro` expands them. It finds packages as `ros_packages` says. Each element of the result is preceded by a
processing instruction with the file and the line of the element that it comes from, which `parse_xml` reads.
"""

from __future__ import annotations

import io
import json
import re
import threading
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stderr
from pathlib import Path
from typing import Any
from xml.dom import minidom

from mbd_sim.base.errors import InputError, MechanismError, Problem, nearest, quoted
from mbd_sim.base.packages import require_packages
from mbd_sim.files.text.library import NO_PACKAGE, XACRO_SUFFIX
from mbd_sim.files.text.ros_packages import package_folders
from mbd_sim.files.text.xml import FILES, PLACE, Element, is_xml, mended, parse_xml

_USED = re.compile(r"\$\(arg\s+([\w.-]+)\s*\)|\barg\(\s*'([\w.-]+)'")
_COMMENT, _PROGRAM = re.compile("<!--.*?-->", re.DOTALL), re.compile(r"<xacro:|\$[{(]")
_LOCK = threading.Lock()  # xacro keeps its state in its module


def is_xacro(text: str, file: str) -> bool:
    """Whether a text is a xacro file, by the ending of its file or the namespace that it declares.

    What xacro has written declares it too, and contains nothing of it but in comments.
    """
    if not is_xml(text):
        return False
    return file.endswith(XACRO_SUFFIX) or ("xmlns:xacro" in text and bool(_PROGRAM.search(_COMMENT.sub("", text))))


def expanded(text: str, file: str, arguments: Mapping[str, str]) -> str:
    """The text, or what it writes if it is a xacro file.

    :raises MechanismError: there are arguments for a file that takes none, or the file is wrong.
    """
    if is_xacro(text, file):
        return expanded_xacro(text, file, arguments)
    if arguments:
        message, remedy = "this is not a xacro file, and takes no arguments", "Leave them out."
        if not text.lstrip().startswith("<"):
            remedy = "Write them into the file: 'xacro: {name: value}' beside 'urdf'."
        name, value = next(iter(arguments.items()))
        raise MechanismError([Problem(message, remedy, key="xacro", value=f"{name}:={value}", file=file)])
    return text


def expanded_xacro(text: str, file: str, arguments: Mapping[str, str]) -> str:
    """The text that a xacro file writes, with the places of its elements if it is a URDF or an SDF.

    :param file: the file; paths in it count from its folder.
    :param arguments: the values of `<xacro:arg>` by name.
    :raises MissingPackageError: xacro is not installed.
    :raises MechanismError: the file is wrong; with the file, the line and a remedy.
    """
    require_packages("xacro", purpose=f"Expanding {Path(file).name}", otherwise=f"or give what 'xacro {file}' prints")
    import xacro

    with _LOCK:
        expansion = _XacroRun(xacro, file, arguments)
        return expansion.text(text)


class _XacroRun:
    """One run of xacro."""

    def __init__(self, xacro: Any, file: str, arguments: Mapping[str, str]) -> None:
        self.xacro, self.file, self.arguments = xacro, file, arguments
        self.known: set[str] = set()  # names of arguments in the files

    def text(self, text: str) -> str:
        messages = io.StringIO()
        try:
            with self._own_functions(), redirect_stderr(messages):
                self.xacro.init_stacks(self.file)
                document = self.parsed(text, self.file)
                self.xacro.process_doc(document, mappings=dict(self.arguments))
        except MechanismError:
            raise
        except Exception as error:  # xacro raises what the expressions of a file raise
            raise self._error(error) from None
        if unknown := self._unknown():
            raise MechanismError(unknown)
        return _written(document, [line for line in messages.getvalue().splitlines() if line.startswith("warning: ")])

    def parsed(self, text: str, file: str) -> minidom.Document:
        """The document of a file, whose elements know their place, also when they are copied."""
        root = parse_xml(text, file)
        self.known |= {one.attributes.get("name", "") for one in root.walk() if one.tag == "xacro:arg"}
        self.known |= {name for pair in _USED.findall(text) for name in pair}
        # `parse_xml` has refused what is dangerous in XML.
        document = minidom.parseString(mended(text)[0] if root.slips else text)  # noqa: S318
        for node, element in zip(document.getElementsByTagName("*"), root.walk(), strict=True):
            node.setUserData(PLACE, element, _KEPT)
        return document

    @contextmanager
    def _own_functions(self) -> Iterator[None]:
        """Let xacro read files and find packages by the functions here."""
        from xacro import substitution_args

        names = substitution_args._eval_dict
        before = self.xacro.parse, substitution_args._eval_find, names["find"]
        self.xacro.parse = self._read
        substitution_args._eval_find = names["find"] = self._found
        try:
            yield
        finally:
            self.xacro.parse, substitution_args._eval_find, names["find"] = before

    def _read(self, document: Any, filename: str | None = None) -> Any:
        """In place of `xacro.parse`, which reads a file that is included."""
        if document is not None or filename is None:
            return document
        try:
            return self.parsed(Path(filename).read_text(encoding="utf-8"), filename)
        except (OSError, UnicodeDecodeError) as error:
            self.xacro.filestack.pop()
            reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
            unread = error if isinstance(error, OSError) else OSError(reason)
            raise self.xacro.XacroException(f"{filename}: {reason}", exc=unread) from error

    def _found(self, package: str) -> str:
        """The folder of a package, for `$(find …)`."""
        folder = Path(self.file).absolute().parent
        found = next((path for path in package_folders(package, folder) if path.is_dir()), None)
        if found is None:
            raise _PackageError(package)
        return str(found)

    def _unknown(self) -> list[Problem]:
        """The arguments that none of the files has."""
        message, otherwise = "there is no <xacro:arg> of this name", "The file has no arguments: leave it out."
        return [
            Problem(message, nearest(name, self.known) or otherwise, key="xacro", value=quoted(name), file=self.file)
            for name in self.arguments
            if name not in self.known
        ]

    def _error(self, error: BaseException) -> MechanismError:
        places = _places(error)
        plain, remedy = _explained(error, self.known)
        file, line = (places[0].file, places[0].line) if places else (str(self.xacro.filestack[-1]), 0)
        callers = [f"{one.file}:{one.line}" for one in places[1:]][:3]
        if callers:
            plain += f" (called from {', then '.join(callers)})"
        problem = Problem(plain, remedy, key=places[0].tag if places else "", file=file, line=line)
        return MechanismError([*self._unknown(), problem])


class _PackageError(Exception):
    """There is no package of this name."""


class _Kept:
    """Gives copies of an element the place of the element."""

    @staticmethod
    def handle(operation: int, key: str, data: Any, source: Any, copy: Any) -> None:
        if copy is not None:
            copy.setUserData(key, data, _KEPT)


_KEPT = _Kept()


def _place_of(node: Any) -> Element | None:
    while node is not None:
        place: Element | None = node.getUserData(PLACE)
        if place is not None:
            return place
        node = node.parentNode
    return None


def _places(error: BaseException) -> list[Element]:
    """The element that xacro was at when it raised an error, then the calls of the macros around it."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)][::-1]
    found: list[Element] = []
    for frame in frames:
        node = frame.f_locals.get("node", frame.f_locals.get("elt"))
        called = frame.f_code.co_name == "handle_macro_call"
        place = _place_of(node) if isinstance(node, minidom.Node) and (called or not found) else None
        if place is not None and (not found or (place.file, place.line) != (found[-1].file, found[-1].line)):
            found.append(place)
    return found


def _explained(error: BaseException, known: set[str]) -> tuple[str, str]:
    """What is wrong, in words of this package where the kind is known, and a remedy."""
    text = " ".join(str(error).split())
    inner: BaseException | None = error
    while (further := getattr(inner, "exc", None)) is not None:
        inner = further
    expression = text.rpartition("when evaluating expression ")[2] if "when evaluating expression" in text else ""
    within = f" in the expression {expression}" if expression else ""
    match inner:
        case _PackageError():
            return f"there is no package {quoted(str(inner))}", NO_PACKAGE
        case RecursionError():
            return "a macro or a file contains itself without end", "Add a condition that ends it."
        case InputError():
            return inner.message, inner.remedy
        case _ if type(inner).__name__ == "ArgException":
            name = str(inner)
            others = nearest(name, known - {name})
            return f"the argument {quoted(name)} has no value", f"Give it as {name}:=VALUE. {others}".strip()
        case NameError():
            return f"{inner}{within}", "Define it with <xacro:property>, or correct the name."
        case OSError():
            return f"cannot read {inner.filename or text}: {inner.strerror or inner}", "Check the path."
        case SyntaxError():
            return f"is not a valid expression: {inner.msg}{within}", "Correct it: expressions are Python's."
    if text.startswith("unknown macro name: "):
        return f"there is no macro {text.partition(': ')[2]}", "Include the file that defines it, or correct the name."
    if text.startswith("Undefined parameters"):
        return (
            f"the macro needs these parameters: {text.partition('[')[2].rstrip(']')}",
            "Give them where it is called.",
        )
    return f"xacro says: {text or type(inner).__name__}", "Correct this element, or the arguments."


def _written(document: minidom.Document, warnings: list[str]) -> str:
    """The text of a document, with the place of each element."""
    root = document.documentElement
    assert root is not None
    if root.tagName not in ("robot", "sdf"):  # the compiler of MJCF takes no processing instructions
        return document.toxml()
    files: dict[str, int] = {}
    for node in document.getElementsByTagName("*"):
        if (place := node.getUserData(PLACE)) is not None and node.parentNode is not None:
            number = files.setdefault(place.file, len(files))
            node.parentNode.insertBefore(document.createProcessingInstruction(PLACE, f"{number} {place.line}"), node)
    head = json.dumps({"files": list(files), "warnings": [line.removeprefix("warning: ") for line in warnings]})
    document.insertBefore(document.createProcessingInstruction(FILES, head.replace("?>", "? >")), document.firstChild)
    return document.toxml()
