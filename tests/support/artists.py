"""What is in a picture, found by its name."""

from kaju import plot


def axes_of(of, *what, **options):
    return plot(of, *what, **options).axes[0]


def part(ax, name):
    """The one collection called `name`."""
    (found,) = (one for one in ax.collections if one.get_gid() == name)
    return found


def drawn(ax, name):
    """The polygons of the collection called `name`."""
    return [path.vertices for path in part(ax, name).get_paths()]


def notes(ax):
    return " ".join(text.get_text() for text in ax.texts if text.get_gid() == "notes")
