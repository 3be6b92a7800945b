"""A whole dataset through the pipeline: which copies to make, where they go, and what came of them."""

import shutil
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

from rpaug.core.errors import BadInput
from rpaug.core.files import apart, write_changed
from rpaug.core.owner import owned
from rpaug.pipeline import journal, output_folder, prepare, report, totals
from rpaug.pipeline import workers as local
from rpaug.pipeline.inputs import see_handles_hold
from rpaug.pipeline.job import Job
from rpaug.pipeline.journal import Journal
from rpaug.pipeline.missing_copies import MissingCopies, job_of
from rpaug.pipeline.run import Budget, Run, Summary

__all__ = ["Run", "Summary", "check", "execute", "finish"]

Progress = Callable[[int, int], None]
Runner = Callable[[Iterable[Job]], Iterator[local.Outcome]]
Engine = Callable[[Iterable[Job], int, Budget | None], Iterator[local.Outcome]]
"""Does jobs, so many at once, each within the budget. Whichever does them, the same bytes come out."""
NO_LOCKS = "this file system knows no locks: another run that writes here is not kept out"
OF_DATASET = "another dataset, or this one with files that were changed, added or removed since"


def check(run: Run, resume: bool = False) -> None:
    """See that a run may start. Raises BadInput, Unsupported."""
    if run.ratio and any(report.synthetic(run.source, key) for key in run.keys):
        expected = "recorded ones, of which the ratio is"
        raise BadInput(run.source, "--ratio", found="synthetic episodes", expected=expected)
    assert run.keys  # raises for a dataset that is none, or a selection that is empty
    see_handles_hold(run.recipe, run.adapter, run.source, run.keys)
    apart(run.target, run.source)
    if not run.target.exists():
        return
    if not resume:
        raise BadInput(
            run.target, "--out", found="something there already", expected="a new path, or --resume"
        )
    described = journal.marker(run.target)
    if described is None and run.target.is_dir() and not any(run.target.iterdir()):
        return  # killed before it wrote anything
    if described is None:
        found, expected = "no run of rpaug here", "the --out of a stopped run"
        raise BadInput(run.target / journal.NAME, "--resume", found=found, expected=expected)
    for name, value in ({"share": None, "ratio": None, "shard": None} | run.marker).items():
        if described.get(name) != value:
            what = OF_DATASET if name == "contents" else f"another {name}"
            raise BadInput(
                run.target / journal.NAME, name, found=what, expected="the one being resumed"
            )


def execute(
    run: Run,
    *,
    workers: int = 1,
    budget: Budget | None = None,
    engine: Engine = local.run,
    resume: bool = False,
    progress: Progress = lambda done, total: None,
) -> Summary:
    """Augment a dataset; `budget` is that of each job, `engine` does them: on this machine, or on a cluster's. Raises
    BadInput for what is wrong before the first episode.

    A bad episode among good ones is skipped and named in the summary. Every finished episode appears by one rename,
    so a killed run leaves only whole ones and can be resumed. If nothing could be made, nothing is left behind. While
    it runs the target is its own: another run is refused.
    """
    with owned(run.target) as held:
        summary = _executed(run, lambda jobs: engine(jobs, workers, budget), resume, progress)
    if not held:
        summary.warnings[str(run.target)] = [NO_LOCKS]
    return summary


def _executed(run: Run, runner: Runner, resume: bool, progress: Progress) -> Summary:
    check(run, resume)
    made_folders = output_folder.missing(run.target)
    journal.begin(run.target, run.marker, run.source.resolve())
    output_folder.sweep(run.target)
    held = output_folder.mend(run)
    todo = MissingCopies(run, held.made)
    summary = Summary(resumed=len(held.made))
    total, finished = todo.copies, 0
    progress(0, total)
    for outcome in _outcomes(_staged(run, todo), runner):
        finished += outcome.copies
        if outcome.fatal:
            summary.aborted, summary.missing = outcome.error, outcome.missing
        elif outcome.error and outcome.job.copies:  # who borrows from it says so too
            summary.failures[outcome.job.key] = outcome.error
        progress(finished, total)
    if todo:
        held = journal.read(run.target)
    if held.made or run.shard:
        finish(run, held, summary)
    elif made_folders:
        shutil.rmtree(made_folders[-1], ignore_errors=True)
    return summary


def finish(run: Run, held: Journal, summary: Summary) -> None:
    """Gather what is new, and say what all came to. Episodes of a part of a run, or of one that the machine stopped,
    stay apart, under the numbers that they have in the whole."""
    whole = not (run.shard or summary.stopped)
    for within in output_folder.FOLDERS:
        if output_folder.stale(held, within) and whole:
            output_folder.close_gaps(run, held, within)
            output_folder.gather(run, held, within)
    kept, rejected = (
        journal.facts(run.target, held.made.of(within)) for within in output_folder.FOLDERS
    )
    totals.add_up(summary, run, kept, rejected)
    if whole:
        output_folder.write_card(run, held)
    described = vars(summary) | {"dataset": str(run.source.resolve()), **run.marker}
    write_changed(run.target / report.SUMMARY, report.encode(described))


def _staged(run: Run, todo: Iterable[Job]) -> list[Iterable[Job]]:
    """The jobs in turns: what lends Gaussians to others is fitted before them, and once."""
    if not run.share:
        return [todo]
    donated = prepare.donors(run.adapter, run.source, [job.key for job in todo])
    donors = dict.fromkeys(donated.values())
    own = {job.key: job for job in todo}
    first = [own.get(key) or job_of(run, key, ()) for key in donors]
    rest = [replace(job, donor=donated.get(job.key)) for job in todo if job.key not in donors]
    return [first, rest]


def _outcomes(stages: Iterable[Iterable[Job]], runner: Runner) -> Iterator[local.Outcome]:
    for stage in stages:
        fatal = False
        for outcome in runner(stage):
            yield outcome
            fatal |= outcome.fatal
        if fatal:
            return
