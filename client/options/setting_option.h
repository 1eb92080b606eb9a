/* setting_option: the rows of settings.h as options. */
#pragma once

#include "common/cli/options.h"
#include "common/schema/setting.h"

/* What was said to a row: a text, NULL: nothing; of a SET each time. */
union setting_said {
    const char *text;
    struct option_list list;
};

/* The row of a command's table. */
struct option setting_option(const struct setting *row, union setting_said *said);

/* What was said, into the members of `record`. ERR_USAGE. */
status settings_said(const struct setting *rows, int count, const union setting_said *said, void *record,
                     struct error *err) MUST_CHECK;
