"""The step `straightness` of `calibrate`: along a mirror, spliced where it is shorter than the travel, or without."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from rotary_error_monitor.calibration.flatness_doubts import covariance_csv
from rotary_error_monitor.calibration.measurements import read_mirror_profile
from rotary_error_monitor.calibration.straightness_report import mirror_csv, straightness_text
from rotary_error_monitor.calibration.straightness_runs import ReadingSettings
from rotary_error_monitor.calibration.straightness_step import (
    Asked,
    Direct,
    StraightnessResult,
    calibrate_straightness,
)
from rotary_error_monitor.commands.calibration_arguments import (
    NOT_GOOD,
    Subparsers,
    add_columns,
    add_figure,
    add_place,
    job_of,
    place_of,
    step,
)
from rotary_error_monitor.commands.values import flatness_um, not_negative, positive
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import write_whole
from rotary_error_monitor.metrology.reference_mirror import ReferenceMirror


def add(steps: Subparsers[argparse.ArgumentParser]) -> None:
    """Describe the step's arguments."""
    text = (
        "an interferometer along the axis, or overlapping segments along a mirror: "
        "segment,run,direction,position_mm,reading_um; mirror as well if turned"
    )
    parser = step(steps, "straightness", _straightness, text)
    parser.add_argument("--component", required=True, help="such as EYX: straightness of X in Y")
    parser.add_argument("--noise-um", type=positive, required=True, help="standard deviation of a reading")
    parser.add_argument(
        "--position-noise-mm",
        type=not_negative,
        default=0.0,
        help="standard deviation of where a stop is, for runs that share their stops (default 0)",
    )
    parser.add_argument(
        "--drop-outliers", action="store_true", help="leave readings out that stand off from those of other runs"
    )
    add_columns(parser, "segment=Seg run=Run direction=Dir position=X,mm reading=Gauge,um")
    _add_mirror(parser)
    _add_direct(parser)
    add_place(parser, temperature="")
    add_figure(parser)
    add_figure(parser, "draw the runs and how they repeat", "--runs-figure")
    parser.add_argument(
        "--covariance", type=Path, metavar="OUT.csv", help="write the curve's covariance, for `calibrate flatness`"
    )
    parser.add_argument(
        "--monotone", action="store_true", help="rotate the curve so that its correction never reverses"
    )


def _add_mirror(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("mirror", "of readings along a mirror; a straightness interferometer has none")
    group.add_argument("--mirror-length-mm", type=positive)
    group.add_argument(
        "--mirror-flatness-um", type=flatness_um, default=argparse.SUPPRESS, help="peak to valley, or 'unknown'"
    )
    group.add_argument("--mirror-profile", type=Path, metavar="CSV", help="its calibrated form: distance_mm,height_um")
    group.add_argument(
        "--mirror-form", type=Path, metavar="OUT.csv", help="write its form as several placements show it"
    )


def _add_direct(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("direct measurement", "to hold the spliced one against")
    group.add_argument("--direct", type=Path, metavar="CSV", help="the same straightness, measured as one segment")
    add_columns(group, "position=X,mm reading=Gauge,um …", "of this table", "--direct-columns")
    group.add_argument("--direct-mirror-length-mm", type=positive, help="its mirror; none: an interferometer")
    group.add_argument(
        "--direct-flatness-um", type=flatness_um, default=argparse.SUPPRESS, help="of that mirror, or 'unknown'"
    )
    group.add_argument("--direct-noise-um", type=positive, help="of its readings (default: as --noise-um)")


def _straightness(arguments: argparse.Namespace) -> int:
    reading = ReadingSettings(arguments.noise_um * 1e-6, arguments.position_noise_mm * 1e-3, arguments.drop_outliers)
    read = (arguments.mirror_profile, arguments.direct)
    written = (arguments.runs_figure, arguments.mirror_form, arguments.covariance)
    with job_of(arguments, read, written) as job:
        mirror = _mirror_of(arguments, "mirror-length-mm", "mirror-flatness-um", arguments.mirror_profile)
        if mirror is None and arguments.mirror_form is not None:
            raise InputError(f"--mirror-form {arguments.mirror_form} without a mirror: state --mirror-length-mm")
        place = place_of(arguments, job.file.machine)
        direct, is_asked = _direct_of(arguments, reading), arguments.mirror_form is not None
        asked = Asked(arguments.monotone, direct, is_asked, place=place)
        result = calibrate_straightness(job, arguments.component, mirror, reading, asked)
    print(straightness_text(result, job.output))
    form = result.spliced.mirror
    if result.written and arguments.mirror_form and form is not None:
        write_whole(arguments.mirror_form, mirror_csv(form, job.source.name).encode())
    if result.written and arguments.covariance:
        write_whole(arguments.covariance, covariance_csv(result).encode())
    _draw(arguments, result)
    return 0 if result.written else NOT_GOOD


def _draw(arguments: argparse.Namespace, result: StraightnessResult) -> None:
    if arguments.figure or arguments.runs_figure:
        from rotary_error_monitor.report.straightness import draw_runs, draw_straightness

        for path, draw in ((arguments.figure, draw_straightness), (arguments.runs_figure, draw_runs)):
            if path:
                draw(path, result)


def _mirror_of(
    arguments: argparse.Namespace, length: str, flatness: str, profile: Path | None
) -> ReferenceMirror | None:
    """The mirror that two arguments say, by their names; None where neither is given.

    Raises:
        InputError: one of them without the other, or a profile without either.
    """
    size, stated = getattr(arguments, length.replace("-", "_")), flatness.replace("-", "_") in arguments
    if size is None:
        given = f"--{flatness}" if stated else f"--mirror-profile {profile}"
        if stated or profile is not None:
            raise InputError(
                f"{given} without --{length}: state the mirror's length in mm; leave all of the mirror out where "
                "there is none"
            )
        return None
    if not stated:
        raise InputError(
            f"--{length} {size:g} without --{flatness}: state its flatness in µm, peak to valley, or 'unknown'"
        )
    height = getattr(arguments, flatness.replace("-", "_"))
    form = None if profile is None else read_mirror_profile(profile)
    return ReferenceMirror(size * 1e-3, None if height is None else height * 1e-6, form)


def _direct_of(arguments: argparse.Namespace, reading: ReadingSettings) -> Direct | None:
    mirror = _mirror_of(arguments, "direct-mirror-length-mm", "direct-flatness-um", None)
    if arguments.direct is None:
        if mirror is not None:
            raise InputError("--direct-mirror-length-mm without --direct: give the file of the direct measurement")
        if arguments.direct_columns:
            raise InputError("--direct-columns without --direct: give the file of the direct measurement")
        return None
    noise, columns = arguments.direct_noise_um, arguments.direct_columns
    reading = reading if noise is None else replace(reading, noise=noise * 1e-6)
    return Direct(arguments.direct, mirror, reading, ColumnLayout.of(columns) if columns else None)
