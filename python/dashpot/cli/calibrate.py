"""``dashpot calibrate``: fit the problem that a file states."""

from __future__ import annotations

import argparse
from typing import Any

from dashpot.cli import table_problem
from dashpot.cli.options import count, new_file, new_picture, new_report
from dashpot.cli.problem_format import FORMAT


def add_to(commands: Any) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        "calibrate",
        help="fit contact parameters to reference trajectories",
        description="Fit the parameters of a model to observed poses and sensors, with 95 % "
        "intervals and a plain statement for each parameter whether the data identify it.",
        epilog=FORMAT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "problem",
        help="problem file, .toml or .json (format below); or a table, .csv, whose problem the "
        "options --model, --columns, --fit ... state",
    )
    parser.add_argument("--out", type=new_file, metavar="FILE", help="write the result as JSON")
    parser.add_argument(
        "--report", type=new_report, metavar="FILE", help="write a report as one HTML file"
    )
    parser.add_argument(
        "--save", type=new_file, metavar="FILE", help="write the fit, for `dashpot simulate --fit`"
    )
    parser.add_argument(
        "--plot", type=new_picture, metavar="FILE", help="draw residuals and correlations"
    )
    parser.add_argument("--threads", type=count, help="default: one per core")
    table_problem.add_to(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the command."""
    from dashpot.cli.wording import said_in_words_of

    with said_in_words_of(arguments.problem):
        return _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    import json
    import sys

    from rich.console import Console

    from dashpot.calibrate import fit
    from dashpot.cli.problem_file import read_problem
    from dashpot.cli.wording import fit_in_words_of

    if arguments.problem.endswith(".csv"):
        problem, options = table_problem.read_table_problem(arguments)
        held_out = table_problem.read_held_out(arguments, problem)
        print(*table_problem.described(problem), sep="\n", flush=True)
    else:
        table_problem.refuse_options(arguments)
        problem, options = read_problem(arguments.problem)
        held_out = []
    try:
        result = fit(problem, **options, nthread=arguments.threads, progress=sys.stderr.isatty())
    except (ValueError, TypeError) as error:
        raise ValueError(f"{arguments.problem}: {error}") from error
    result = fit_in_words_of(arguments.problem, result)
    Console().print(result.table())
    for estimate in result.estimates:
        print(f"{estimate.name}: {estimate.statement}")
    if len(result.combinations) > 1:
        print("known independently of each other:")
        for combination in result.combinations:
            print(f"  {combination}")
    metrics = result.metrics()
    errors = []
    if "position_rms" in metrics:
        errors.append(f"{1e3 * metrics['position_rms']:.4g} mm")
    if "rotation_rms" in metrics:
        errors.append(f"{metrics['rotation_rms']:.4g} rad")
    for name, value in metrics.items():
        if name.startswith("sensors."):
            errors.append(f"{name.removeprefix('sensors.').removesuffix('_rms')} {value:.4g}")
    print(
        f"residuals: {', '.join(errors)} (root mean square); "
        f"{result.evaluations} simulations in {result.seconds:.1f} s"
    )
    unseen = {"held_out": held_out, "head": arguments.head} if held_out else {}
    if unseen:
        Console().print(result.predict(held_out, head=arguments.head).table())
    if arguments.out is not None:
        text = json.dumps(result.to_dict(), indent=2) + "\n"
        arguments.out.write_text(text, encoding="utf-8")
        print(f"wrote {arguments.out}")
    if arguments.plot is not None:
        result.plot(arguments.plot)
        print(f"wrote {arguments.plot}")
    if arguments.save is not None:
        result.save(arguments.save)
        print(f"wrote {arguments.save}")
    if arguments.report is not None:
        title = f"Calibration: {arguments.problem}"
        result.report(arguments.report, title=title, **unseen)
        print(f"wrote {arguments.report}")
    return 0
