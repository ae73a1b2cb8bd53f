"""Mechanism files with random words changed in one section."""

from __future__ import annotations

import random
import re

from mbd_sim import MechanismError, parse_mechanism

ODD_WORDS = ("null", "-1", "1e300", "nan", "ground", "t", "[]", "{}")


def changed_files(lines, section, count, seed):
    """Copies of a file's lines with other, missing and doubled words in the lines of a section, a range."""
    chance = random.Random(seed)
    words = [*re.findall(r"[\w.]+|[^\s\w]", "\n".join(lines[line] for line in section)), *ODD_WORDS]
    for _ in range(count):
        changed = list(lines)
        for _ in range(chance.choice([1, 1, 2, 5])):
            number = chance.choice(section)
            found = list(re.finditer(r"[\w.]+|[^\s\w]", changed[number]))
            if not found:
                continue
            word = chance.choice(found)
            other = chance.choice([chance.choice(words), "", word[0] * 2])
            changed[number] = changed[number][: word.start()] + other + changed[number][word.end() :]
        yield changed


def loaded_or_refused(lines, section, key, use):
    """Whether a file loads and can be used; otherwise every problem has a line, in the section if its key is there.

    `use` takes the mechanism, and may refuse it as well.
    """
    try:
        use(parse_mechanism("\n".join(lines) + "\n", "file.yaml"))
    except MechanismError as error:
        for problem in error.problems:
            assert problem.message and problem.remedy, problem
            assert problem.file == "file.yaml" and 1 <= problem.line <= len(lines)
            assert not problem.key.startswith(key) or problem.line - 1 in (section.start - 1, *section), problem
        return False
    return True
