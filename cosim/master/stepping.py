"""The loop: who steps when, with which inputs, and what is written down.

Every step of a participant lies between two of its own communication points. Its inputs are sampled at
the first and held; its outputs appear at the second and are held until the next. So results depend on
the rates and the order, never on how the loop is carried out.

* Jacobi: all inputs are sampled at the beginning of a step. The order of participants does not matter.
* Gauss-Seidel: a participant sees those before it as they are at the *end* of its step already.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from cosim.ending import asking
from cosim.master.clock import PER_SECOND, Clock
from cosim.master.participants import Participant, SimulationError
from cosim.signals import Signal
from driveline.quantities import InputError

_FIRST, _LAST = 1 << 62, 1 << 61  # marks of the first and the last event, beside the bits of the rates


@dataclass
class Seat:
    """A participant in its place: where its values lie on the bus and where its inputs come from.

    Attributes:
        participant: Who sits here.
        period: Length of its step [ns].
        start: Values set before the run: parameters and inputs that never change.
        inputs, outputs: Names of what is exchanged at every step.
        input_slots, output_slots: Their places on the bus.
        sources: For each input the slot it is taken from.
        factor, offset: Unit conversion for each input.
        early: For each input whether it comes from a participant earlier in the order.
        feeds: Whether an output of it is an input of somebody.
    """

    participant: Participant
    period: int
    start: dict[str, float | str]
    inputs: list[str]
    outputs: list[str]
    input_slots: slice
    output_slots: slice
    sources: np.ndarray
    factor: np.ndarray
    offset: np.ndarray
    early: np.ndarray
    feeds: bool


@dataclass
class Recording:
    """What a run wrote down: ``rows[:count]``, every ``period`` [ns] from the start and at the stop."""

    clock: Clock
    period: int
    rows: np.ndarray
    count: int = 0

    def times(self) -> np.ndarray:
        """The instants of the rows [s]."""
        ticks = self.clock.start + np.arange(self.count, dtype=np.int64) * self.period
        return np.minimum(ticks, self.clock.stop) / PER_SECOND


@dataclass
class _Plan:
    """What happens at events of one kind."""

    finish: list[tuple]
    sample: list[Callable[[], None]]
    record: bool


class Loop:
    """One run.

    Args:
        seats: The participants in their order.
        bus: All values that are exchanged or recorded, float64.
        signals: The signals that vary, in the order of the first slots of the bus.
        clock: The instants; its periods hold those of the seats and ``record_period``.
        recorded: Slots to write down.
        record_period: How often [ns].
        gauss_seidel: The order; False for Jacobi.
    """

    def __init__(self, seats: list[Seat], bus: np.ndarray, signals: list[Signal], clock: Clock,
                 recorded: np.ndarray, record_period: int, gauss_seidel: bool) -> None:
        self._seats, self._bus, self._signals, self._clock = seats, bus, signals, clock
        self._recorded, self._gauss_seidel = recorded, gauss_seidel
        self._record_bit = clock.bit(record_period)
        count = clock.count(record_period)
        try:  # zeros take no memory before they are written to, so a long run may end early
            rows = np.zeros((count, recorded.size))
        except (MemoryError, ValueError) as error:
            raise InputError(f"{recorded.size} values at {count} instants are more than there is memory for: record "
                             "fewer, at a longer step of the record, or let the run stop earlier") from error
        self.recording = Recording(clock, record_period, rows)
        self._samplers = [self._sampler(seat) for seat in seats]

    def initialize(self) -> None:
        """Open everybody, then initialize one after the other along the connections.

        Within a loop whoever comes first sees the start values of outputs that do not exist yet.
        """
        clock, bus = self._clock, self._bus
        start, stop = clock.start / PER_SECOND, clock.stop / PER_SECOND
        bus[:len(self._signals)] = self._signal_values(np.array([start]))[0]
        for seat in self._seats:
            seat.participant.open(seat.start, seat.inputs, seat.outputs,
                                  bus[seat.input_slots], bus[seat.output_slots])
        for seat, sample in self._in_order_of_initialization():
            sample()
            seat.participant.initialize(start, stop)

    def run(self, progress: Callable[[float], None] | None = None) -> int | None:
        """Step to the end; afterwards ``recording`` holds the rows.

        Args:
            progress: Called now and then with the instant reached [s].

        Returns:
            The signal that ended the run early, as Ctrl-C does; None where none did.

        Raises:
            SimulationError: A participant failed, or a value is not finite. The rows until then are valid.
        """
        clock, bus, recording, recorded = self._clock, self._bus, self.recording, self._recorded
        varying = bus[:len(self._signals)]
        rows, plans = recording.rows, {}
        with _interruptions() as interrupted:
            for times, masks in clock.blocks():
                masks[times == clock.start] |= _FIRST
                masks[times == clock.stop] |= _LAST
                values = self._signal_values(times / PER_SECOND)
                first = recording.count
                try:
                    for now, mask, signal_row in zip(times.tolist(), masks.tolist(), values):
                        if interrupted:
                            return interrupted[0]
                        plan = plans.get(mask)
                        if plan is None:
                            plan = plans[mask] = self._plan(mask)
                        for refresh, advance, back, step, read in plan.finish:
                            if refresh is not None:
                                refresh()
                            advance((now - back) / PER_SECOND, step)
                            if read is not None:
                                read()
                        varying[:] = signal_row
                        for sample in plan.sample:
                            sample()
                        if plan.record:
                            bus.take(recorded, out=rows[recording.count], mode="clip")
                            recording.count += 1
                except SimulationError:
                    self._check_finite(first)  # what was recorded before may be why
                    raise
                self._check_finite(first)
                if progress is not None:
                    progress(now / PER_SECOND)
        return None

    def close(self) -> None:
        """Free all participants, also those of a failed run."""
        for seat in self._seats:
            seat.participant.close()

    def _in_order_of_initialization(self) -> list[tuple[Seat, Callable[[], None]]]:
        """Sources before receivers; of those in one loop whoever was given first."""
        owner = {slot: position for position, seat in enumerate(self._seats)
                 for slot in range(seat.output_slots.start, seat.output_slots.stop)}
        waiting = {position: {owner[slot] for slot in seat.sources.tolist() if slot in owner} - {position}
                   for position, seat in enumerate(self._seats)}

        def before(position: int) -> set[int]:
            """Who still waits of its sources, of theirs and so on: in a loop itself too."""
            found: set[int] = set()
            further = {position}
            while further:
                further = {p for at in further for p in waiting[at] & waiting.keys()} - found
                found |= further
            return found

        ordered = []
        while waiting:
            ready = next(p for p in waiting if all(p in before(source) for source in before(p)))
            del waiting[ready]
            ordered.append((self._seats[ready], self._samplers[ready]))
        return ordered

    def _plan(self, mask: int) -> _Plan:
        clock, finish = self._clock, []
        record = bool(mask & self._record_bit or mask & _LAST)
        due = [bool(mask & clock.bit(seat.period)) for seat in self._seats]
        for seat, seat_is_due in zip(self._seats, due):
            if mask & _FIRST or not (seat_is_due or mask & _LAST):
                continue
            step = seat.period if seat_is_due else (clock.stop - clock.start) % seat.period
            refresh = self._refresher(seat) if self._gauss_seidel and seat.early.any() else None
            # its outputs are held until its next step ends: nobody sees them before then unless somebody is fed,
            # or the record has instants between the ends of its steps
            seen = seat.feeds or record or self.recording.period % seat.period
            read = seat.participant.read if seat.outputs and seen else None
            finish.append((refresh, seat.participant.advance, step, step / PER_SECOND, read))
        sample = [sampler for sampler, seat, seat_is_due in zip(self._samplers, self._seats, due)
                  if (seat_is_due or mask & _LAST) and seat.inputs]
        return _Plan(finish, sample, record)

    def _sampler(self, seat: Seat) -> Callable[[], None]:
        """Takes all inputs of a seat from their sources."""
        bus, sources, target = self._bus, seat.sources, self._bus[seat.input_slots]
        factor, offset = seat.factor, seat.offset
        if (factor == 1.0).all() and (offset == 0.0).all():
            def sample() -> None:
                bus.take(sources, out=target, mode="clip")
        else:
            def sample() -> None:
                bus.take(sources, out=target, mode="clip")
                np.multiply(target, factor, out=target)
                np.add(target, offset, out=target)
        return sample

    def _refresher(self, seat: Seat) -> Callable[[], None]:
        """Takes those inputs again whose source comes earlier in the order."""
        bus, target, early = self._bus, self._bus[seat.input_slots], np.flatnonzero(seat.early)
        sources, factor, offset = seat.sources[early], seat.factor[early], seat.offset[early]

        def refresh() -> None:
            target[early] = bus[sources] * factor + offset
        return refresh

    def _signal_values(self, seconds: np.ndarray) -> np.ndarray:
        values = np.empty((seconds.size, len(self._signals)))
        for column, source in enumerate(self._signals):
            values[:, column] = source.values(seconds)
        return values

    def _check_finite(self, first: int) -> None:
        recording = self.recording
        bad = ~np.isfinite(recording.rows[first:recording.count])
        if bad.any():
            row, column = (int(i) for i in np.argwhere(bad)[0])
            when = float(recording.times()[first + row])
            recording.count = first + row  # what is before it is good
            raise NotFinite(column, when)


class NotFinite(SimulationError):
    """A recorded value is NaN or infinite; the master knows the name of the column."""

    def __init__(self, column: int, time: float) -> None:
        super().__init__(f"recorded column {column} is not finite at t = {time:.9g} s")
        self.column, self.time = column, time


@contextmanager
def _interruptions() -> Iterator[list[int]]:
    """A list of the signals, Ctrl-C's and others that Python handles, that came to end the run.

    Left alone, Python would raise KeyboardInterrupt wherever it happens to be, and that may be inside
    an FMU written in Python, which then fails fatally. A second signal of the kind does just that.
    """
    interrupted: list[int] = []
    if threading.current_thread() is not threading.main_thread():
        yield interrupted
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *asking())}
    # what Python does not handle is left alone, but for a Ctrl-C that is ignored; None is a handler of whoever
    # embeds Python, which could not be put back
    before = {number: handler for number, handler in before.items()
              if callable(handler) or (number == signal.SIGINT and handler is not None)}

    def note(number: int, _frame: object) -> None:
        interrupted.append(number)
        signal.signal(number, before[number])

    for number in before:
        signal.signal(number, note)
    try:
        yield interrupted
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
