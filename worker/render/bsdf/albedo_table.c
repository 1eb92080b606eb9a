/* The tables of albedo.h, of which albedo_table.bin has the bits: float32, little-endian, one table after another
 * in the order below. tests/numerics/test_albedo_table.c compares every entry with its definition, and writes the
 * file (--print).
 *
 * The file is not made at build time: quadrature takes 47 s, and its sines and powers are the C library's, so
 * two workers' tables could differ in a bit. */
#include <stddef.h>

#include "worker/render/bsdf/albedo.h"

#define TABLES(X)                                                                                 \
    X(blend) X(blend_average) X(loss) X(loss_mean) X(schlick_mean) X(stretched_loss)              \
    X(stretched_mean) X(interface_loss) X(interface_mean) X(interface_lost) X(sheen) X(exact)     \
    X(exact_mean) X(exact_kept_mean)

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "albedo_table.bin is little-endian");

#define MEMBER(table) __typeof__(albedo_##table) table;
struct albedo_file { TABLES(MEMBER) };

#define PLACE(table)                                                                              \
    __asm__(".pushsection .rodata\n"                                                              \
            ".balign 64\n"                                                                        \
            ".globl albedo_" #table "\n"                                                          \
            ".type albedo_" #table ", %%object\n"                                                 \
            ".size albedo_" #table ", %c1\n"                                                      \
            "albedo_" #table ": .incbin \"worker/render/bsdf/albedo_table.bin\", %c0, %c1\n"      \
            ".popsection"                                                                         \
            :: "i"(offsetof(struct albedo_file, table)), "i"(sizeof albedo_##table));

/* Never called: statements of assembly take sizes from C in functions alone. */
__attribute__((used)) static void place_tables(void) { TABLES(PLACE) }
