/* Colours and rules of the plots. The hues are those of Okabe and Ito, which people with any kind
 * of colour vision can distinguish, lighter for dark backgrounds and darker for white paper; marks
 * differ as well, so that a grey print can be read. */
#include <ctype.h>
#include <string.h>

#include "client/study/page/study_plot.h"

static const struct {
    const char *name, *day, *night;
} colours[] = {
    {"paper", "#ffffff", "#15171b"},   {"panel", "#f5f6f8", "#1d2025"},
    {"ink", "#16191d", "#eceef1"},     {"soft", "#59616b", "#a7aeb8"},
    {"axis", "#868e98", "#747c87"},    {"grid", "#e8ebee", "#2a2e35"},
    {"faint", "#d5dae0", "#353b44"},   {"visible", "#fbf1d3", "#332d1b"},
    {"accent", "#0072b2", "#56b4e9"},  {"one", "#d55e00", "#f28b45"},
    {"two", "#00875f", "#35c99c"},     {"three", "#b2548a", "#e3a3c7"},
    {"four", "#a87400", "#ecc04d"},    {"usual", "#9aa1ab", "#7c848f"},
    {"warnink", "#8a4300", "#f7b978"}, {"warnpaper", "#fdeedd", "#33261a"},
    {"okink", "#00623f", "#7fdcbb"},   {"okpaper", "#e3f4ed", "#16291f"},
};
enum { COLOUR_COUNT = sizeof colours / sizeof colours[0] };

const char study_plot_rules[] =
    ".plot text{font:12px system-ui,'Segoe UI','Helvetica Neue',Arial,sans-serif;fill:$ink}\n"
    ".plot .tick{fill:$soft;font-variant-numeric:tabular-nums}\n"
    ".plot .title{fill:$soft;font-size:11px}\n"
    ".plot .label,.plot .name{paint-order:stroke;stroke:$paper;stroke-width:4px;"
    "stroke-linejoin:round}\n"
    ".plot .name{font-size:11px}\n"
    ".plot .strong{font-weight:600;fill:$ink}\n"
    ".plot .accent{font-weight:600;fill:$accent}\n"
    ".plot .faintword{font-size:11px;fill:$soft}\n"
    ".plot .paper{fill:$paper}\n"
    ".plot path,.plot line{fill:none}\n"
    ".plot .axis{stroke:$axis}\n"
    ".plot .grid{stroke:$grid}\n"
    ".plot .faint{stroke:$faint;stroke-dasharray:1 4;stroke-linecap:round}\n"
    ".plot .slope{stroke:$soft;stroke-width:1.2}\n"
    ".plot .leader{stroke:$axis;stroke-opacity:.5}\n"
    ".plot .visible{fill:$visible}\n"
    ".plot .band{fill:$accent;fill-opacity:.16}\n"
    ".plot .fit{stroke:$accent;stroke-width:2}\n"
    ".plot .beyond{stroke-dasharray:5 4;stroke-width:1.5}\n"
    ".plot .target{stroke:$ink;stroke-width:1.2}\n"
    ".plot .costband{fill:$ink;fill-opacity:.07}\n"
    ".plot .goal{fill:$paper;stroke:$ink;stroke-width:2}\n"
    ".plot .curve{stroke-width:2;stroke-linejoin:round}\n"
    ".plot .mark,.plot .interval{stroke-width:1.5}\n"
    ".plot .floor{stroke-width:3}\n"
    ".plot .floorband{fill-opacity:.25}\n"
    ".plot .c0{stroke:$accent}.plot .c1{stroke:$one}.plot .c2{stroke:$two}"
    ".plot .c3{stroke:$three}.plot .c4{stroke:$four}\n"
    ".plot .mark.c0{fill:$accent}.plot .mark.c1,.plot .f1{fill:$one}"
    ".plot .mark.c2,.plot .f2{fill:$two}.plot .mark.c3,.plot .f3{fill:$three}"
    ".plot .mark.c4,.plot .f4{fill:$four}\n"
    ".plot .t1{fill:$one}.plot .t2{fill:$two}.plot .t3{fill:$three}.plot .t4{fill:$four}\n"
    ".plot .mark.usual{fill:$usual;stroke:$usual}.plot .curve.usual{stroke:$usual}"
    ".plot .name.usual{fill:$soft}\n"
    ".plot .mark.doubt{fill:$paper}\n"
    ".plot .interval{stroke-width:3;stroke-linecap:round;stroke-opacity:.55}\n"
    ".plot .bar{fill:$usual}.plot .bar.spare{fill:$two}.plot .sparezone{fill:$okpaper}\n";

/* The colour whose name begins `text`, the longest one; COLOUR_COUNT: none. */
static size_t colour_at(const char *text, size_t length)
{
    for (size_t i = 0; i < COLOUR_COUNT; i++)
        if (strlen(colours[i].name) == length && memcmp(colours[i].name, text, length) == 0)
            return i;
    return COLOUR_COUNT;
}

void study_style_rules(struct buffer *out, const char *rules, int variables)
{
    const char *at = rules;

    while (*at) {
        const size_t plain = strcspn(at, "$");
        size_t length = 0, colour;

        buffer_append(out, at, plain);
        at += plain;
        if (!*at)
            break;
        at++;
        while (isalpha((unsigned char)at[length]))
            length++;
        colour = colour_at(at, length);
        if (variables)
            buffer_printf(out, "var(--%.*s)", (int)length, at);
        else
            buffer_puts(out, colour < COLOUR_COUNT ? colours[colour].day : "#000");
        at += length;
    }
}

void study_style_variables(struct buffer *out, int night)
{
    for (size_t i = 0; i < COLOUR_COUNT; i++)
        buffer_printf(out, "--%s:%s;", colours[i].name, night ? colours[i].night : colours[i].day);
}
