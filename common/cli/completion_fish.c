/* fish: a line for each option. */

#include "common/cli/completion.h"

static void put_condition(const struct completion *c, struct buffer *out, const struct completion_command *command)
{
    buffer_printf(out, "complete -c %s", c->program);
    if (!command->name)
        return;
    buffer_puts(out, " -n '__");
    completion_put_function(c, out);
    buffer_printf(out, "_is %s'", command->name);
}

static void put_value(const struct completion *c, struct buffer *out, enum completion_value value, const char *words)
{
    switch (value) {
    case COMPLETE_NOTHING: return;
    case COMPLETE_TEXT: buffer_puts(out, " -x"); return;
    case COMPLETE_FILE: buffer_puts(out, " -r -F"); return;
    case COMPLETE_FOLDER: buffer_puts(out, " -x -a '(__fish_complete_directories)'"); return;
    case COMPLETE_WORDS: buffer_printf(out, " -x -a '%s'", words); return;
    case COMPLETE_LIST:
        buffer_puts(out, " -x -a '(__");
        completion_put_function(c, out);
        buffer_printf(out, "_list %s)'", words);
        return;
    case COMPLETE_JOB: case COMPLETE_JOBS: case COMPLETE_FILE_OR_JOB:
        buffer_puts(out, " -x -a '(__");
        completion_put_function(c, out);
        buffer_puts(out, value == COMPLETE_JOBS ? "_jobs names)'" : "_jobs numbers)'");
        return;
    }
}

static void put_command(const struct completion *c, struct buffer *out, const struct completion_command *command)
{
    for (size_t i = 0; i < command->count; i++) {
        const struct completion_option *o = &command->options[i];

        put_condition(c, out, command);
        buffer_printf(out, " -l %s", o->name);
        if (o->letter)
            buffer_printf(out, " -s %c", o->letter);
        put_value(c, out, o->value, o->words);
        buffer_puts(out, " -d '");
        completion_put_help(out, o->help, "'\\");
        buffer_puts(out, "'\n");
    }
    put_condition(c, out, command);
    buffer_puts(out, " -l help -s h -d 'print the help'\n");
    put_condition(c, out, command);
    if (command->value == COMPLETE_FILE) {
        buffer_puts(out, " -F\n");
        return;
    }
    buffer_puts(out, command->value == COMPLETE_FILE_OR_JOB ? " -F" : " -f");
    if (command->value == COMPLETE_FILE_OR_JOB || command->value == COMPLETE_JOB || command->value == COMPLETE_JOBS) {
        buffer_puts(out, " -k -a '(__");
        completion_put_function(c, out);
        buffer_puts(out, command->value == COMPLETE_JOBS ? "_jobs names)'" : "_jobs numbers)'");
    } else if (command->words) {
        buffer_printf(out, " -a '%s'", command->words);
    }
    buffer_puts(out, "\n");
}

/* fish's helpers, `P` standing for the program's function. */
static const char helpers[] =
    "function P_is\n"
    "    set -l words (commandline -opc)\n"
    "    test (count $words) -ge 2; and test $words[2] = $argv[1]\n"
    "end\n"
    "function P_list\n"
    "    set -l begun (string replace -r '^--[^=]*=' '' -- (commandline -ct) | string replace -r '[^,]*$' '')\n"
    "    printf '%s\\n' $begun$argv\n"
    "end\n"
    "function P_jobs\n"
    "    set -l words (commandline -opc)\n"
    "    set -l jobs (command $words[1] completion --jobs -- $words[2..-1] 2>/dev/null)\n"
    "    test $argv[1] = names; or set jobs (string match -r '^[0-9]+\\t.*' -- $jobs)\n"
    "    printf '%s\\n' $jobs\n"
    "end\n";

void completion_write_fish(const struct completion *c, struct buffer *out)
{
    int has_commands = c->count > 0 && c->commands[0].name != NULL;

    buffer_printf(out, "# fish completion for %s, made by 'azulejo completion fish'\n", c->program);
    for (const char *at = helpers; has_commands && *at; at++) {
        if (at[0] == 'P' && at[1] == '_') {
            buffer_puts(out, "__");
            completion_put_function(c, out);
        } else {
            buffer_printf(out, "%c", *at);
        }
    }
    if (has_commands)
        buffer_printf(out, "complete -c %s -f\n", c->program);
    for (size_t i = 0; has_commands && i < c->count; i++) {
        buffer_printf(out, "complete -c %s -n __fish_use_subcommand -a %s -d '", c->program, c->commands[i].name);
        completion_put_help(out, c->commands[i].summary, "'\\");
        buffer_puts(out, "'\n");
    }
    for (size_t i = 0; i < c->count; i++)
        put_command(c, out, &c->commands[i]);
}
