"""`exodrake warm-up`: compile the kernels now, not at first use."""

import click


@click.command()
def command() -> None:
    """Compile the nominal robot's simulation into numba's cache; later sessions load it in a second or two."""
    from time import perf_counter

    from rich.console import Console

    from exodrake.simulation.warm_up import JOBS, warm_up

    start = perf_counter()
    with Console(stderr=True).status(f"compiling {', '.join(JOBS)}") as status:
        warm_up(lambda done, left: status.update(f"compiled {done}; still {', '.join(left) or 'nothing'}"))
    click.echo(f"compiled {', '.join(JOBS)} in {perf_counter() - start:.0f} s")
