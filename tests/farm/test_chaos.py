"""A few rounds of chaos.py; `make chaos` runs as many as it is asked for."""
import sys

sys.dont_write_bytecode = True  # no __pycache__ in the sources
import chaos
from disk import PowerDisk
from farm import Skip, Tests
from jobs import expect

tests = Tests()


@tests.add
def short():
    """two rounds of random disasters lose no job and change no pixel"""
    rounds, lost, other, pixels = chaos.run(2, 0, 4200)
    print("# %d rounds, %d lost jobs, %d other pictures, %d other bytes" % (rounds, lost, other, pixels))
    expect(rounds == 2 and lost == 0 and other == 0, (rounds, lost, other))


@tests.add
def power_cuts():
    """the coordinator's machine loses its power four times: no job is lost, no pixel changes, what was answered stays"""
    with PowerDisk() as power:
        if not power:
            raise Skip("power cuts need " + PowerDisk.NEEDS)
    lost, other, _, done = chaos.one_round(4300, 4, chaos.reference(), "power_cut")
    expect(lost == 0 and other == 0 and len(done) == 4, (lost, other, done))


if __name__ == "__main__":
    tests.run()
