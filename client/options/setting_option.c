#include "client/options/setting_option.h"

#include "client/terminal/parse.h"

struct option setting_option(const struct setting *row, union setting_said *said)
{
    return (struct option){.name = row->option,
                           .kind = row->kind == SETTING_KIND_SET ? OPTION_LIST : row->words ? OPTION_CHOICE : OPTION_STRING,
                           .target = said,
                           .argument = row->placeholder,
                           .help = row->help,
                           .choices = row->words};
}

status settings_said(const struct setting *rows, int count, const union setting_said *said, void *record,
                     struct error *err)
{
    status result = STATUS_OK;

    for (int i = 0; i < count && result == STATUS_OK; i++) {
        const size_t texts = rows[i].kind == SETTING_KIND_SET ? said[i].list.count : said[i].text != NULL;

        for (size_t k = 0; k < texts && result == STATUS_OK; k++) {
            const char *text = rows[i].kind == SETTING_KIND_SET ? said[i].list.items[k] : said[i].text;

            result = rows[i].kind == SETTING_KIND_SET && rows[i].choice == CHOICE_EFFECT
                         ? parse_effects(text, (uint64_t *)(void *)((char *)record + rows[i].offset), err)
                         : setting_parse(&rows[i], text, record, err);
        }
    }
    return result;
}
