"""What a replay had to leave out, and what it noticed on the way."""

from collections import Counter

from pfcli.findings import Finding, of_loss

_NOTES = 10


class Dropped:
    """What a replay had to leave out: counts by reason, and the sentences that say where; and findings of any kind."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.notes: list[str] = []
        self.read: Counter[str] = Counter()
        self.found: list[Finding] = []
        self._said: dict[str, list[str]] = {}

    def add(self, why: str, note: str, keep: int = 1) -> None:
        """Count one dropped; the first notes of a kind are kept."""
        self.counts[why] += 1
        if self.counts[why] <= keep:
            self.notes.append(note)
            self._said.setdefault(why, []).append(note)

    def find(self, finding: Finding) -> None:
        """Note a finding; one of a code and place is enough."""
        if not any((f.code, f.where) == (finding.code, finding.where) for f in self.found):
            self.found.append(finding)

    def __bool__(self) -> bool:
        return bool(self.counts)

    def take(self, other: "Dropped") -> None:
        """Add what another replay lost."""
        self.counts.update(other.counts)
        self.read.update(other.read)
        self.notes.extend(other.notes)
        for why, notes in other._said.items():
            self._said.setdefault(why, []).extend(notes)
        for finding in other.found:
            self.find(finding)

    def findings(self) -> list[Finding]:
        """Everything as findings: what was found, a loss for each reason, a note for each sentence without a count."""
        lost = [of_loss(why, count, self._said.get(why, ())) for why, count in self.counts.items() if count]
        counted = {note for notes in self._said.values() for note in notes}
        loose = [note for note in dict.fromkeys(self.notes) if note not in counted][:_NOTES]
        notes = [Finding(code="W614", severity="note", where="", seen=note, effect="", way_out="") for note in loose]
        return [*self.found, *lost, *notes]
