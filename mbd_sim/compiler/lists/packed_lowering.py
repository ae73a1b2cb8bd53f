"""Packed operations to LLVM IR: a vector operation for each pack, a scalar one for each other node.

Each lane takes the same IEEE operation as in `mbd_sim.compiler.lists.lowering`, so that the results have the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import accumulate

import casadi as ca

from mbd_sim.compiler.ir.builder import DOUBLE, INT, IRBuilder, element, local_array, number
from mbd_sim.compiler.ir.lanes import LaneBuilder
from mbd_sim.compiler.ir.module import Function, Module, Value, vector_of
from mbd_sim.compiler.lists.instruction_list import Instructions, Output
from mbd_sim.compiler.lists.like_operations import WIDTHS, Pack
from mbd_sim.compiler.lists.lowering import INLINE_SINES, SINES, Lowering, define, pieces
from mbd_sim.compiler.lists.packing import Packing, Unit, packed_angles, vector_size

SIGN = -(2**63)  # the bit of the sign


def lower_packed(module: Module, like: Instructions, packing: Packing, inline: bool) -> Function:
    """Emit packed operations with the name and the arguments of a function: see `lower`."""
    inputs, outputs = like.n_in(), like.n_out()
    emitted, builder = define(module, like.name(), inputs + outputs, inline, 1)
    split = [packing.units[piece.start : piece.stop] for piece in pieces(len(packing.units))]
    if len(split) == 1:
        _PackedLowering(module, builder, packing, emitted.args, inputs).run(packing.units)
    else:
        places = _places(split)
        memory = local_array(builder, sum(len(nodes) for nodes in places))
        for index, piece in enumerate(split):
            part, inside = define(module, f"{like.name()}.{index}", inputs + outputs + 1, False, 1)
            _PackedLowering(module, inside, packing, part.args[:-1], inputs, places, part.args[-1]).run(piece)
            inside.ret_void()
            builder.call(part, [*emitted.args, memory])
    builder.ret_void()
    return emitted


def _places(split: Sequence[Sequence[Unit]]) -> dict[tuple[int, ...], int]:
    """Where in memory the values are that one piece computes and others use."""
    home = {node: (index, unit.nodes) for index, piece in enumerate(split) for unit in piece for node in unit.nodes}
    shared = dict.fromkeys(
        home[node][1]
        for index, piece in enumerate(split)
        for unit in piece
        for nodes in unit.operands
        for node in nodes
        if home[node][0] != index
    )
    return dict(zip(shared, accumulate((len(nodes) for nodes in shared), initial=0), strict=False))


def _constants(values: Sequence[Value]) -> Value:
    """A vector of constants."""
    entries = ", ".join(f"{value.type} {value.text}" for value in values)
    return Value(vector_of(values[0].type, len(values)), f"<{entries}>")


class _PackedLowering:
    """The emission of units, with the values that are formed once and used again."""

    def __init__(
        self,
        module: Module,
        builder: IRBuilder,
        packing: Packing,
        arguments: Sequence[Value],
        inputs: int,
        places: Mapping[tuple[int, ...], int] | None = None,
        memory: Value | None = None,
    ) -> None:
        """Values with `places` in `memory` are stored there when they are computed, and loaded where they are not."""
        self._builder, self._nodes, self._memory = builder, packing.graph.nodes, memory
        self._inputs, self._outputs = arguments[:inputs], arguments[inputs:]
        self._places = {} if places is None else places
        self._pack_of = {node: unit.nodes for unit in packing.units if len(unit.nodes) > 1 for node in unit.nodes}
        self._stored: dict[int, list[Output]] = {}
        for output in packing.graph.outputs:
            self._stored.setdefault(output.node, []).append(output)
        inline = len(packing.units) <= INLINE_SINES
        builders = {width: LaneBuilder(builder.block, width) for width in WIDTHS}
        self._lanes = {width: (wide, Lowering(module, wide, inline)) for width, wide in builders.items()}
        self._scalars = Lowering(module, builder, inline)
        self._values: dict[tuple[int, ...], Value] = {}  # of a node, or of a vector of nodes
        self._flipped: dict[tuple[tuple[int, ...], tuple[bool, ...]], Value] = {}  # with signs changed
        self._angles: Mapping[Pack, Sequence[Pack]] = {}  # the angles of a group, which are inputs
        self._sines_cosines: dict[Pack, tuple[Value, Value]] = {}  # of the angles of groups

    def run(self, units: Sequence[Unit]) -> None:
        """Emit units in order."""
        self._angles = packed_angles([unit.operands[0] for unit in units if self._is_sine_of_inputs(unit)])
        for unit in units:
            nodes = unit.nodes
            if unit.operands:
                self._values[nodes] = self._result(unit)
                if nodes in self._places:
                    self._save(nodes)
            for node in nodes:
                for _, result, component in self._stored.get(node, ()):
                    address = element(self._builder, self._outputs[result], component)
                    self._builder.store(self._value((node,)), address)

    def _result(self, unit: Unit) -> Value:
        """Emit an operation."""
        if unit.operation in SINES and unit.operands[0] in self._angles:
            return self._sine_cosine(unit.operands[0])[unit.operation == ca.OP_COS]
        low = self._lanes[len(unit.nodes)][1] if len(unit.nodes) > 1 else self._scalars
        if unit.operation == ca.OP_ADD and len(set(unit.negated)) == 2 and all(len(set(n)) == 1 for n in unit.negated):
            one, other = (self._value(nodes) for nodes in unit.operands)
            return low.builder.fsub(other, one) if unit.negated[0][0] else low.builder.fsub(one, other)
        signed = [self._signed(*each) for each in zip(unit.operands, unit.negated, strict=True)]
        return low.operation(unit.operation, *signed)

    def _is_sine_of_inputs(self, unit: Unit) -> bool:
        return unit.operation in SINES and all(self._nodes[node].operation == ca.OP_INPUT for node in unit.operands[0])

    def _sine_cosine(self, angles: Pack) -> tuple[Value, Value]:
        """The sine and the cosine of an angle or a pack of angles, computed with all others of the group."""
        if angles not in self._sines_cosines:
            group = self._angles[angles]
            values = [self._value((node,)) for pack in group for node in pack]
            lanes = vector_size(len(values))
            wide, low = self._lanes[lanes]
            pair = low.sine_cosine(wide.gathered(values + values[-1:] * (lanes - len(values))))
            first = 0
            for pack in group:
                sine, cosine = (self._part(wide, value, range(first, first + len(pack))) for value in pair)
                self._sines_cosines[pack] = sine, cosine
                first += len(pack)
        return self._sines_cosines[angles]

    def _part(self, wide: LaneBuilder, vector: Value, lanes: range) -> Value:
        """Some neighbouring lanes of a vector, or one as a scalar."""
        if len(lanes) == wide.lanes:
            return vector
        return wide.lane(vector, lanes.start) if len(lanes) == 1 else wide.part(vector, lanes)

    def _signed(self, nodes: tuple[int, ...], negated: tuple[bool, ...]) -> Value:
        """The values of nodes, some of them with the sign changed."""
        if not any(negated):
            return self._value(nodes)
        if (nodes, negated) not in self._flipped:
            builder, _ = self._lanes[len(nodes)]
            if all(self._nodes[node].operation == ca.OP_CONST for node in nodes):
                values = [self._nodes[node].value for node in nodes]
                found = _constants([number(-v if minus else v) for v, minus in zip(values, negated, strict=True)])
            elif all(negated):
                found = builder.fneg(self._value(nodes))
            else:
                mask = _constants([Value(INT, str(SIGN if minus else 0)) for minus in negated])
                found = builder.bitcast(builder.xor(builder.bitcast(self._value(nodes), INT), mask), DOUBLE)
            self._flipped[nodes, negated] = found
        return self._flipped[nodes, negated]

    def _value(self, nodes: tuple[int, ...]) -> Value:
        """The value of a node, or the vector of the values of several."""
        if nodes not in self._values:
            self._values[nodes] = self._scalar(nodes[0]) if len(nodes) == 1 else self._vector(nodes)
        return self._values[nodes]

    def _scalar(self, node: int) -> Value:
        operation, operands, value = self._nodes[node]
        if operation == ca.OP_CONST:
            return number(value)
        if operation == ca.OP_INPUT:
            return self._builder.load(element(self._builder, self._inputs[operands[0]], operands[1]), typ=DOUBLE)
        if node in self._pack_of:
            pack = self._pack_of[node]
            return self._lanes[len(pack)][0].lane(self._value(pack), pack.index(node))
        return self._builder.load(self._place((node,)), typ=DOUBLE)

    def _vector(self, nodes: tuple[int, ...]) -> Value:
        builder, _ = self._lanes[len(nodes)]
        if self._pack_of.get(nodes[0]) == nodes:
            return builder.load(self._place(nodes), typ=DOUBLE)
        values = [self._value((node,)) for node in nodes]
        if all(value == values[0] for value in values):
            return builder.widened(values[0])
        if all(value.is_constant for value in values):
            return _constants(values)
        return builder.gathered(values)

    def _save(self, nodes: tuple[int, ...]) -> None:
        builder = self._lanes[len(nodes)][0] if len(nodes) > 1 else self._builder
        builder.store(self._values[nodes], self._place(nodes))

    def _place(self, nodes: tuple[int, ...]) -> Value:
        if self._memory is None:
            raise KeyError(f"the value of the nodes {nodes} is used before it is computed")
        return element(self._builder, self._memory, self._places[nodes])
