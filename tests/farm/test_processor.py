"""A picture's bits do not depend on the variants of its functions that the C library chooses by the
processor. Embree is pinned by the job; this is about all else (docs/NUMERICS.md)."""
import os
import subprocess
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import exr
from farm import BIN, ROOT, Farm, Failure, Skip, Tests, read_bytes

tests = Tests()
OLD = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX512F,-AVX2,-AVX,-FMA,-FMA4,-SSE4_2,-SSE4_1,-SSSE3"}
# Between them they call every elementary function: the sky's map and its sun, dielectrics, spectra of
# dispersion and of films, media with and without a grid, lobes, textures, lens, shutter, lights.
SCENES = [("sky.pbrt", "drago03"), ("glass.gltf", "reinhard02"), ("dispersion.gltf", "aces"),
          ("fire.pbrt", "mantiuk06"), ("media.pbrt", "mantiuk08"), ("texture-filter.gltf", "agx"),
          ("iridescence.gltf", "drago03"), ("sheen.gltf", "gamma"), ("coated.pbrt", "reinhard02"),
          ("lens.pbrt", "aces"), ("shutter.pbrt", "agx"), ("slides.pbrt", "mantiuk08"),
          ("motion.gltf", "gamma"), ("window.pbrt", "mantiuk06")]
# Of libm what is exact, so that no variant can differ.
EXACT = {"ceil", "ceilf", "fabs", "fabsf", "floor", "floorf", "fma", "fmaf", "fmax", "fmaxf", "fmin",
         "fminf", "fmod", "fmodf", "frexp", "frexpf", "ldexp", "ldexpf", "modf", "modff",
         "nextafter", "nextafterf", "rint", "rintf", "round", "roundf", "scalbn", "sqrt", "sqrtf",
         "trunc", "truncf"}


def library_bits(env):
    """What the C library itself makes of a sine, in many places."""
    words = "import math; print(sum(math.sin(i * 0.37) * (i % 7 + 1) for i in range(200000)).hex())"
    return subprocess.check_output([sys.executable, "-c", words],
                                   env=dict(os.environ, **env)).strip()


def pictures(env):
    """Every scene by a farm of its own: the EXR's samples and the PNG's bytes."""
    found = {}
    with Farm() as farm:
        farm.start_coordinator(env=env)
        farm.start_worker(env=env, threads=2)
        jobs = []
        for name, operator in SCENES:
            done = farm.cli("submit", os.path.join(ROOT, "scenes", "features", name), "--json",
                            "--size", "40x28", "--spp", "4", "--tonemap", operator, expect=0,
                            env=env)
            jobs.append((name, done.json()["job"]))
        for name, job in jobs:
            farm.wait_for_job(job)
            for path in farm.fetch(job, "out-%d" % job):
                kind = os.path.splitext(path)[1]
                found[name, kind] = (exr.read_exr(path).bits() if kind == ".exr"
                                     else read_bytes(path))
    return found


@tests.add
def same_bits():
    """a processor without AVX, FMA and SSE4 gives the same pictures to the bit"""
    if library_bits({}) == library_bits(OLD):
        raise Skip("the C library has no other variants for this processor")
    new, old = pictures({}), pictures(OLD)
    if sorted(new) != sorted(old) or len(new) != 2 * len(SCENES):
        raise Failure("outputs: %s and %s" % (sorted(new), sorted(old)))
    different = ["".join(key) for key in sorted(new) if new[key] != old[key]]
    if different:
        raise Failure("differ with GLIBC_TUNABLES=%s: %s" % (OLD["GLIBC_TUNABLES"], different))


@tests.add
def no_foreign_functions():
    """worker and coordinator call none of libm's functions that are not exact"""
    listed = subprocess.run(["ldd", os.path.join(BIN, "azulejo-worker")], stdout=subprocess.PIPE)
    libm = [line.split()[2] for line in listed.stdout.decode().splitlines()
            if line.strip().startswith("libm.so")]
    if not libm:
        raise Skip("the programs are not linked with a shared libm")

    def symbols(path, *how):
        lines = subprocess.check_output(["nm", "-D", *how, path]).decode().splitlines()
        return {line.split()[-1].split("@")[0] for line in lines}
    offered = symbols(libm[0], "--defined-only")
    if "sinf" not in offered:
        raise Failure("%s offers no sinf" % libm[0])
    for program in ("azulejo-worker", "azulejo-coordinator"):
        called = (symbols(os.path.join(BIN, program), "-u") & offered) - EXACT
        if called:
            raise Failure("%s calls %s: use common/math/elementary.h" % (program, sorted(called)))


tests.run()
