"""Contrast processing by Mantiuk, Myszkowski and Seidel 2006 in numpy: what compare_tonemap.py holds
the programs against. Written down from the definitions, in double, without regard to speed.
"""
import numpy


def shares(count):
    """Of half as many pixels i: how much each covers of the pixels 2 i, 2 i + 1 and 2 i + 2."""
    i = numpy.arange(count // 2)[:, None]
    return (1 - i / len(i), (i + 1) / len(i)) if count % 2 else (numpy.ones_like(i), None)


def halve(plane):
    """The means of what half as many lines cover."""
    first, last = shares(len(plane))
    total = first * plane[:-1:2] + plane[1::2] if last is not None else plane[::2] + plane[1::2]
    if last is not None:
        total += last * plane[2::2]
    return total * (len(total) / len(plane))


def spread(plane, count):
    """The other way about: lines that are halved to these, by the transpose."""
    first, last = shares(count)
    out = numpy.zeros((count, plane.shape[1]))
    out[:2 * len(plane):2] = first * plane
    out[1::2] = plane
    if last is not None:
        out[2::2] += last * plane
    return out


def differences(plane):
    """To the right and lower neighbour; 0 where there is none."""
    return numpy.stack([numpy.diff(plane, axis=1, append=plane[:, -1:]),
                        numpy.diff(plane, axis=0, append=plane[-1:])])


def divergence(field):
    x, y = field
    return numpy.diff(x, axis=1, prepend=0) + numpy.diff(y, axis=0, prepend=0)


class Contrasts:
    """Of a plane of log10 luminance, at all levels down to sides of 3 to 5 pixels."""
    # The response counts thresholds; W is the contrast at which it is 0, 1, 2 ... 106.
    W = [0.0, 0.01]
    while len(W) < 107:
        W.append(W[-1] + 0.0928 * W[-1] ** 1.08 + 0.0046 * W[-1] ** -0.18)
    R = numpy.arange(107)

    def __init__(self, plane):
        self.plane = plane

    def levels(self, plane):
        yield plane
        while min(plane.shape) >= 6:
            plane = halve(halve(plane).T).T
            yield plane

    def gather(self, fields):
        """The sum of all levels' divergences, on level 0."""
        total = divergence(fields[-1])
        for field in fields[-2::-1]:
            _, height, width = field.shape
            total = divergence(field) + spread(spread(total, height).T, width).T
        return total

    def responses(self):
        return [numpy.sign(g) * numpy.interp(10 ** abs(g) - 1, self.W, self.R)
                for g in map(differences, self.levels(self.plane))]

    def wanted(self, responses):
        return [numpy.sign(r) * numpy.log10(1 + numpy.interp(abs(r), self.R, self.W))
                for r in responses]

    def solve(self, wanted, steps=500, tolerance=1e-4):
        """The plane whose differences are nearest to them, by conjugate gradients."""
        weights = [1 / (0.038737 * numpy.maximum(abs(g), 0.001) ** 0.537756) for g in wanted]
        x = self.plane - self.plane.mean()
        right = self.gather([w * g for w, g in zip(weights, wanted)])

        def product(plane):
            return self.gather([w * differences(level)
                                for w, level in zip(weights, self.levels(plane))])
        x = x * (x * right).sum() / (x * product(x)).sum()
        residual = right - product(x)
        residual -= residual.mean()
        step, square = residual, (residual ** 2).sum()
        for _ in range(steps):
            if square <= tolerance ** 2 * (right ** 2).sum():
                break
            turned = product(step)
            alpha = square / (step * turned).sum()
            x, residual = x + alpha * step, residual - alpha * turned
            before, square = square, (residual ** 2).sum()
            step = residual + square / before * step
        return x


def equalized(responses, factor, full_corners=False):
    """Contrast equalization: a pixel's pair of responses keeps its ratio, and its length becomes the
    share of all lengths, of all levels, that are shorter: their cumulative histogram. In the last
    corner, where there is no neighbour, pfstools' 0 / 0 becomes the full response: full_corners."""
    lengths = [numpy.hypot(*r) for r in responses]
    ordered = numpy.sort(numpy.concatenate([l.ravel() for l in lengths]))
    out = []
    for r, length in zip(responses, lengths):
        rank = numpy.searchsorted(ordered, length) / len(ordered)
        scaled = r * (106 * factor * rank / numpy.maximum(length, 1e-30))
        if full_corners:
            scaled[:, length == 0] = 106
        out.append(scaled)
    return out
