"""What became of Slurm's jobs, by its queue: for clusters that keep no accounts, which submitit asks otherwise."""

from __future__ import annotations

import subprocess
import time
from typing import Any

from submitit.slurm.slurm import SlurmInfoWatcher

# Every job of this user that the controller remembers, the tasks of an array each in a line of its own.
COMMAND = ("squeue", "--me", "--array", "--states=all", "--noheader", "--format=%i|%T")
# A controller forgets jobs some minutes after their end (MinJobAge); what it does not name is over.
FORGOTTEN = "COMPLETED"
# Seconds between two questions at most.
DELAY = 30


class Queue(SlurmInfoWatcher):
    """Tells states of jobs as `squeue` does, in place of `sacct`."""

    def __init__(self) -> None:
        super().__init__(delay_s=DELAY)

    def update(self) -> None:
        """Ask once for all jobs. Where the controller does not answer, each is left as it was last seen."""
        self._last_status_check = time.time()
        self._num_calls += 1
        try:
            found = subprocess.run(COMMAND, capture_output=True, text=True, check=True).stdout
        except (OSError, subprocess.CalledProcessError):
            return
        seen = dict(line.split("|", 1) for line in found.splitlines() if "|" in line)
        for job in self._registered - self._finished:
            state = seen.get(job, FORGOTTEN)
            told: dict[str, Any] = {"JobID": job, "State": state.strip()}
            self._info_dict[job] = told
            if self.is_done(job, mode="cache"):
                self._finished.add(job)
