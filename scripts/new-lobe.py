#!/usr/bin/env python3
"""make new-lobe NAME=x: a lobe's file, its rows, its lines in the tests and a row of the manual.

What is made builds and passes, and changes no picture until a material sets the field x. Replace the model, then what says TODO
(docs/EXTENDING.md). Nothing is written unless all of it can be."""
import os
import re
import subprocess
import sys

ROOT = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..")
WIDTH = 99  # column of a macro's backslashes

LOBE = '''/* lobe_@x@: TODO what it is, and whose model (author, year, title, equations). As made, light goes back
 * to where it came from:
 *
 *   f = weight (n + 1) / (2 pi) max(wo.wi, 0)^n
 *
 * Reciprocal; with the cosine it sends out at most its weight. It lies over the base and leaves
 * 1 - weight of what lies below. Sampled by its power of wo.wi, which is a density around wo. */
#pragma once

#include "worker/render/bsdf/lobe.h"
#include "worker/render/bsdf/warp.h"

#define @X@_POWER 16 /* @x@_density squares four times */

static inline void @x@_init(struct bsdf *b, const struct bsdf_params *p, struct vec3 wo)
{
    (void)wo;
    b->@x@.weight = clamp_to(p->@x@, 0, 1);
}

static inline real @x@_share(const struct bsdf *b, real *rest)
{
    real above = *rest;

    *rest *= 1.0f - b->@x@.weight;
    return b->@x@.weight * b->cos_o * above;
}

static inline void @x@_cover(const struct bsdf *b, struct vec3 wi, int near, int far,
                             struct cover *cover)
{
    (void)wi, (void)near, (void)far;
    cover->lobe *= 1.0f - b->@x@.weight;
    cover->diffuse *= 1.0f - b->@x@.weight;
}

static inline real @x@_density(struct vec3 wo, struct vec3 wi)
{
    real power = real_min(real_max(vec3_dot(wo, wi), 0), 1);

    for (int n = 1; n < @X@_POWER; n *= 2)
        power *= power;
    return (@X@_POWER + 1) * REAL_INV_2PI * power;
}

static inline struct vec3 @x@_evaluate(const struct bsdf *b, struct vec3 wo, struct vec3 wi,
                                       const struct cover *cover, real *pdf)
{
    real density = @x@_density(wo, wi);

    *pdf = b->lobe_pdf[BSDF_LOBE_@X@] * density;
    return vec3_splat(b->@x@.weight * density * wi.z * cover->@x@);
}

static inline enum lobe_result @x@_sample(const struct bsdf *b, struct vec3 wo, real w, real u,
                                          real v, struct bsdf_sample *out)
{
    struct basis around = basis_from_normal(wo);
    real z = real_pow(1.0f - u, 1 / (real)(@X@_POWER + 1)), radius, sine, cosine;

    (void)b, (void)w;
    radius = real_sqrt(real_max((1.0f - z) * (1.0f + z), 0));
    sincos_turn(v, &sine, &cosine);
    out->wi = basis_to_world(&around, (struct vec3){radius * cosine, radius * sine, z});
    return out->wi.z > 0.0f ? LOBE_SMOOTH : LOBE_NOTHING;
}
'''


class Refused(Exception):
    pass


class Edits:
    """Files with their new contents, written together."""

    def __init__(self, name):
        self.words = {"@x@": name, "@X@": name.upper(), "@shown@": name.replace("_", " ")}
        self.texts = {}

    def fill(self, text):
        for word, value in self.words.items():
            text = text.replace(word, value)
        return text

    def read(self, path):
        if path not in self.texts:
            with open(path, encoding="utf-8") as file:
                self.texts[path] = file.read()
        return self.texts[path]

    def replace(self, path, pattern, new, count=1):
        """Exactly `count` matches of the pattern become new(match)."""
        text, found = re.subn(pattern, new, self.read(path), flags=re.S)
        if found != count:
            raise Refused("%s: %d places look like %r where %d should: put the lobe in by hand, docs/EXTENDING.md tells where" %
                          (path, found, pattern, count))
        self.texts[path] = text

    def before(self, path, anchor, new, count=1):
        new = self.fill(new)
        self.replace(path, re.escape(anchor), lambda match: new + match.group(), count)

    def add_row(self, path, table, row):
        """A last row of a table of the form #define TABLE(X) ... that ends with the first line without a backslash."""
        row = "    " + self.fill(row)

        def add(match):
            last = match.group(2)
            return match.group(1) + continued(last) + row
        self.replace(path, r"(#define %s\([^\n]*\\\n(?:[^\n]*\\\n)*)([^\n]*[^\\\n])(?=\n)" % table, add)

    def write(self):
        for path, text in self.texts.items():
            with open(path, "w", encoding="utf-8") as file:
                file.write(text)


def continued(line):
    """A line of a macro that goes on."""
    return line.rstrip().ljust(WIDTH - 1) + " \\\n" if len(line.rstrip()) < WIDTH else line.rstrip() + " \\\n"


def is_identifier(name):
    """Neither a word of C nor a name of its headers."""
    code = "#include <errno.h>\n#include <math.h>\n#include <stdio.h>\n#include <stdlib.h>\nextern float %s;\n" % name
    return subprocess.run([os.environ.get("CC", "cc"), "-x", "c", "-std=c17", "-D_GNU_SOURCE", "-fsyntax-only", "-"],
                          input=code, text=True, capture_output=True).returncode == 0


def check_name(name):
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,29}", name):
        raise Refused("NAME must be lower case letters, digits and _, at most 30, as in: make new-lobe NAME=velvet")
    upper = name.upper()
    taken = r"(EFFECT|EFFECT_BIT|BSDF_LOBE)_%s|%s_(init|share|cover|density|evaluate|sample|POWER|texture)|dress_%s|%s_POWER" % (
        upper, name, name, upper)
    members = [("common/scene/effects.h", r"X\(%s," % upper), ("common/scene/effects.h", r'"%s"' % name.replace("_", " ")),
               ("common/scene/material_fields.h", r"(VALUE|TEXTURE)\(\w+, %s,|TEXTURE\(%s," % (name, name)),
               ("worker/render/bsdf/bsdf.h", r"\b%s\b[,;\[]" % name), ("worker/render/bsdf/lobe.h", r"\b%s;" % name),
               ("common/scene/scene.h", r"\b%s\b[,;\[]" % name), ("tests/support/bsdf_maker.c", r"\b%s\b" % upper),
               ("tests/unit/render/test_slots.c", r"void %s\(" % name)]
    used = [path for path, pattern in members if re.search(pattern, open(path, encoding="utf-8").read())]
    for room in ("common", "worker", "tests"):
        for folder, _, files in os.walk(room):
            for file in files:
                path = os.path.join(folder, file)
                if file.endswith((".c", ".h")) and re.search(r"\b(%s)\b" % taken, open(path, encoding="utf-8").read()):
                    used.append(path)
    if os.path.exists("worker/render/bsdf/lobe_%s.h" % name):
        used.insert(0, "worker/render/bsdf/lobe_%s.h" % name)
    if used:
        raise Refused("%s is used already in %s: choose another NAME" % (name, used[0]))
    if not is_identifier(name):
        raise Refused("%s is a word of C: choose another NAME" % name)


def add_field(edits):
    """Effect, material field, wire."""
    path = "common/scene/scene.proto"
    message = re.search(r"\nmessage Material \{.*?\n\}", edits.read(path), re.S).group()
    number = 1 + max(int(n) for n in re.findall(r" = (\d+);", message))
    edits.replace(path, r"(\nmessage Material \{.*?)(\n\})", lambda match: match.group(1) + edits.fill(
        "\n  float @x@ = %d;\n  TextureSlot @x@_texture = %d;" % (number, number + 1)) + match.group(2))
    path = "common/scene/effects.h"
    edits.add_row(path, "EFFECT_MAP", 'X(@X@, "@shown@")')
    edits.replace(path, r"(#define EFFECTS_SWITCHABLE[^)]*)\)", lambda match: match.group(1) + edits.fill(" | \\\n     EFFECT_@X@)"))
    rows = ["    /* TODO: weight of the lobe of the same name */",
            "    VALUE(NUMBER, @x@, 0, 0, 1, @X@, MATERIAL, %d)" % number,
            "    TEXTURE(@x@, DATA, FILTERED, READ_BY_LIT, ALONE, MATERIAL, %d, FACTOR," % (number + 1),
            "            PART(@x@, RED))"]
    edits.before("common/scene/material_fields.h", "    VALUE(NUMBER, normal_scale,", "".join(continued(edits.fill(row)) for row in rows))


def add_lobe(edits, name):
    path = "worker/render/bsdf/bsdf.h"
    edits.add_row(path, "BSDF_FACTOR_MAP", "X(@X@, FORM(@x@)) /* weight of the lobe, 0..1 */")
    edits.add_row(path, "BSDF_LAYER_MAP", "X(@X@, @x@, ABOVE, EFFECT_@X@, PROFILE_ACCOUNT(@X@))")
    edits.before(path, "/* Fields below `material`", "/* lobe_@x@.h */\nstruct bsdf_@x@ {\n    real weight;\n};\n\n")
    edits.before(path, "};\n\nenum bsdf_flags", "    struct bsdf_@x@ @x@;\n")
    path = "worker/render/bsdf/layering.h"
    edits.replace(path, r'(?:#include "worker/render/bsdf/[^\n]*\n)+', lambda match: "".join(
        sorted(match.group().splitlines(True) + ['#include "worker/render/bsdf/lobe_%s.h"\n' % name])))
    edits.texts["worker/render/bsdf/lobe_%s.h" % name] = edits.fill(LOBE)


def add_to_makers(edits):
    path = "tests/support/bsdf_maker.c"
    last = max(int(n) for n in re.findall(r"[A-Z]+ = (\d+),", edits.read(path)))
    edits.before(path, "\n};\nstatic const struct { const char *name; unsigned parts; }", "\n    @X@ = %d," % (2 * last))
    edits.before(path, '    {"everything over plastic"', '    {"@shown@ over plastic", @X@},\n')
    edits.before(path, "    if (parts & STRETCHED)\n", "    p.@x@ = parts & @X@ ? 0.5f : 0;\n")
    edits.before(path, "    return p;\n}\n\nstruct bsdf_params bsdf_maker_white",
                 "    if (chance(&own, 30))\n        p.@x@ = 0.5f * test_random_float(&own);\n")
    edits.replace("tests/support/bsdf_maker.h", r"BSDF_MAKER_KINDS = (\d+)",
                  lambda match: "BSDF_MAKER_KINDS = %d" % (int(match.group(1)) + 1))


def add_tests(edits):
    add_to_makers(edits)
    edits.before("tests/statistics/test_bsdf_lobes.c", "    case BSDF_LOBES: fail();\n",
                 "    case BSDF_LOBE_@X@:\n        p.@x@ = 1;\n        break;\n")
    path = "tests/unit/render/test_kernels.c"
    edits.before(path, "static const struct {\n    const char *name, *kernel;",
                 "static void dress_@x@(struct scene_builder *b, struct scene_material *ball)\n{\n    (void)b;\n    ball->@x@ = 0.6f;\n}\n\n")
    edits.before(path, "};\n\nstatic void test_same_bits", '    {"@shown@", "general", dress_@x@},\n')
    edits.before("tests/unit/render/test_profile_scope.c", "    p = grey();\n    p.conductor = 1;\n",
                 '    p = grey();\n    p.@x@ = 0.5f;\n    p.single_scattering = 1;\n'
                 '    assert_charged("@shown@", &p, PROFILE_ACCOUNT(DIFFUSE), EFFECT_DIFFUSE | EFFECT_@X@);\n')
    path = "tests/unit/render/test_slots.c"
    edits.before(path, "static void diffuse_transmission_color(",
                 "static void @x@(struct scene_material *m, int channel)\n{\n    SCALAR_SLOT(@x@, @x@);\n}\n\n")
    edits.before(path, '    {"anisotropy strength",', '    {"@shown@", @x@, R, 0},\n')
    path = "tests/unit/scene/test_material.c"
    edits.before(path, '" base_color normal emission', '" @x@" ')
    edits.before(path, "m.diffuse_roughness = 0;", "m.@x@ = ", 2)
    edits.before("tests/unit/scene/test_effects.c", "    EXPECT(EFFECT_CONDUCTOR | EFFECT_GLOSSY, p.material.kind = MATERIAL_CONDUCTOR);",
                 "    EXPECT(plain_set | EFFECT_@X@, p.material.@x@ = 0.5f);\n")


def add_manual(edits):
    path = "docs/EFFECTS.md"
    edits.before(path, "\n\nThe effects without an entry in the last column",
                 "\n| @shown@ | TODO: what it is, and whose model | weight > 0 | TODO: what the picture loses |")
    edits.replace(path, r"\| general \| everything: also ", lambda match: match.group() + edits.fill("@shown@, "))


def main():
    name = sys.argv[1] if len(sys.argv) == 2 else ""
    os.chdir(ROOT)
    try:
        check_name(name)
        edits = Edits(name)
        add_field(edits)
        add_lobe(edits, name)
        add_tests(edits)
        add_manual(edits)
    except Refused as refusal:
        print("new-lobe: %s" % refusal, file=sys.stderr)
        return 2
    edits.write()
    print("made worker/render/bsdf/lobe_%s.h, and changed:\n  %s" % (name, "\n  ".join(
        path for path in edits.texts if not path.endswith("lobe_%s.h" % name))))
    print("next: replace the model and what says TODO, then: make -s tests && tests/run.sh 'bsdf|unit/(render|scene)/'\n"
          "      then an importer that reads it, and a scene in tests/statistics/test_features.c, which asks for one (docs/EXTENDING.md)")
    return 0


if __name__ == "__main__":
    sys.exit(main())
