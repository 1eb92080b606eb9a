"""The pixels of the picture as the page's canvas shows it, at 1:1."""
from farm import Failure
from png import Png

SURROUND = {False: (0xe6, 0xe6, 0xe6), True: (0x1e, 0x1e, 0x1e)}  # light, dark
MARGIN = 12          # pixels of the surroundings that are looked at, too


def canvas_place(page):
    """(left, top, width, height) of the picture's canvas in whole CSS pixels."""
    return page.wait("""(() => { const c = [...document.querySelectorAll('canvas')].find(e => e.checkVisibility());
        if (!c) return null;
        const r = c.getBoundingClientRect();
        return r.width > 1 && r.height > 1 ? [r.x, r.y, r.width, r.height].map(Math.round) : null; })()""",
                     "the picture's canvas")


def canvas_pixels(page, width=None, height=None):
    """What is on the display where the canvas is (or in so much of its middle): a Png."""
    x, y, w, h = canvas_place(page)
    if width and width < w and height < h:
        x, y, w, h = x + (w - width) // 2, y + (h - height) // 2, width, height
    return Png(page.screenshot((x, y, w, h)))


def picture_pixels(page, width, height, dark=False):
    """Rows of RGB triples of a picture that is shown at 1:1, whole, on the grey of the surroundings."""
    png = canvas_pixels(page, width + 2 * MARGIN, height + 2 * MARGIN)
    n = png.channels
    rows = [[tuple(row[n * x:n * x + 3]) for x in range(png.width)] for row in png.codes]
    grey = SURROUND[dark]
    ys = [y for y, row in enumerate(rows) if any(p != grey for p in row)]
    xs = [x for x in range(png.width) if any(row[x] != grey for row in rows)]
    if not ys:
        raise Failure("the canvas is all grey")
    box = (xs[0], ys[0], xs[-1] - xs[0] + 1, ys[-1] - ys[0] + 1)
    if box[2:] != (width, height):
        raise Failure("the picture is shown as %dx%d pixels, not %dx%d" % (box[2:] + (width, height)))
    return [row[box[0]:box[0] + width] for row in rows[ys[0]:ys[0] + height]]


def png_rows(data):
    png = Png(data)
    n = png.channels
    return [[tuple(row[n * x:n * x + 3]) for x in range(png.width)] for row in png.codes]


def largest_difference(a, b):
    """(codes, x, y) of the largest difference of two pictures' values."""
    return max((max(abs(p - q) for p, q in zip(one, two)), x, y)
               for y, (row, other) in enumerate(zip(a, b)) for x, (one, two) in enumerate(zip(row, other)))
