/* bash: one function, with a case for each command. It needs no bash-completion package. */
#include "common/cli/completion.h"

static const char *const kinds[] = {
    [COMPLETE_NOTHING] = "nothing", [COMPLETE_TEXT] = "text",   [COMPLETE_FILE] = "file",
    [COMPLETE_FOLDER] = "folder",   [COMPLETE_WORDS] = "words", [COMPLETE_LIST] = "list",
    [COMPLETE_JOB] = "job",         [COMPLETE_JOBS] = "jobs",   [COMPLETE_FILE_OR_JOB] = "file-or-job",
};

static const char head[] =
    "    local cur=${COMP_WORDS[COMP_CWORD]} prev= command= options= kind=nothing words= value= values=\n"
    "    local full prefix line key rest only= i\n"
    "    COMPREPLY=()\n"
    "    [ \"$COMP_CWORD\" -gt 0 ] && prev=${COMP_WORDS[COMP_CWORD-1]}\n"
    "    # --name=value is three words for bash\n"
    "    if [ \"$cur\" = = ]; then cur=\n"
    "    elif [ \"$prev\" = = ] && [ \"$COMP_CWORD\" -gt 1 ]; then prev=${COMP_WORDS[COMP_CWORD-2]}; fi\n"
    "    for ((i = 1; i < COMP_CWORD; i++)); do [ \"${COMP_WORDS[i]}\" = -- ] && only=1; done\n"
    "    [ \"$only\" ] && prev=\n";

static const char tail[] =
    "    if [ \"$value\" ]; then kind=$value words=$values\n"
    "    elif [[ $cur == -* && ! $only ]]; then kind=words words=$options; fi\n"
    "    case $kind in\n"
    "    words) COMPREPLY=($(compgen -W \"$words\" -- \"$cur\")) ;;\n"
    "    list)\n"
    "        prefix=${cur%\"${cur##*,}\"}\n"
    "        COMPREPLY=($(compgen -P \"$prefix\" -W \"$words\" -- \"${cur##*,}\"))\n"
    "        compopt -o nospace 2>/dev/null ;;\n"
    "    folder) compopt -o filenames 2>/dev/null; mapfile -t COMPREPLY < <(compgen -d -- \"$cur\") ;;\n"
    "    file | file-or-job) compopt -o filenames 2>/dev/null; mapfile -t COMPREPLY < <(compgen -f -- \"$cur\") ;;\n"
    "    esac\n"
    "    case $kind in\n"
    "    job | jobs | file-or-job)\n"
    "        # A name's ':' separates words for bash, which wants only what follows it.\n"
    "        full=${COMP_LINE:0:COMP_POINT}; full=${full##* } prefix=\n"
    "        [[ $full == *:* && $full == *\"$cur\" ]] && prefix=${full%\"$cur\"} || full=$cur\n"
    "        full=${full//\\\\/}; full=${full#[\\'\\\"]}\n"
    "        mapfile -t line < <(xargs -n 1 printf '%s\\n' <<< \"$COMP_LINE\" 2>/dev/null)  # without their quotes\n"
    "        while IFS=$'\\t' read -r key rest; do\n"
    "            [[ $kind != jobs && $key == *[!0-9]* ]] && continue\n"
    "            [[ $key == \"$full\"* ]] && COMPREPLY+=(\"$(printf %q \"${key#\"$prefix\"}\")\")\n"
    "        done < <(\"${COMP_WORDS[0]}\" completion --jobs -- \"${line[@]:1}\" 2>/dev/null) ;;\n"
    "    esac\n";

/* The names of an option, with `between`. */
static void put_names(struct buffer *out, const struct completion_option *o, const char *between)
{
    buffer_printf(out, "--%s", o->name);
    if (o->letter)
        buffer_printf(out, "%s-%c", between, o->letter);
}

static void put_command(struct buffer *out, const struct completion_command *command, const char *indent)
{
    buffer_printf(out, "%soptions='", indent);
    for (size_t i = 0; i < command->count; i++) {
        put_names(out, &command->options[i], " ");
        buffer_puts(out, " ");
    }
    buffer_printf(out, "--help -h'\n%skind=%s words='%s'\n%scase $prev in\n", indent, kinds[command->value],
                  command->words ? command->words : "", indent);
    for (size_t i = 0; i < command->count; i++) {
        const struct completion_option *o = &command->options[i];

        if (o->value == COMPLETE_NOTHING)
            continue;
        buffer_printf(out, "%s", indent);
        put_names(out, o, " | ");
        buffer_printf(out, ") value=%s", kinds[o->value]);
        if (o->words)
            buffer_printf(out, " values='%s'", o->words);
        buffer_puts(out, " ;;\n");
    }
    buffer_printf(out, "%sesac", indent);
}

void completion_write_bash(const struct completion *c, struct buffer *out)
{
    int has_commands = c->count > 0 && c->commands[0].name != NULL;

    buffer_printf(out, "# bash completion for %s, made by 'azulejo completion bash'\n_", c->program);
    completion_put_function(c, out);
    buffer_printf(out, "() {\n%s", head);
    if (has_commands) {
        buffer_puts(out, "    command=${COMP_WORDS[1]}\n    if [ \"$COMP_CWORD\" -eq 1 ]; then\n        command= kind=words options='--help --version' words='");
        for (size_t i = 0; i < c->count; i++)
            buffer_printf(out, "%s ", c->commands[i].name);
        buffer_puts(out, "help --help --version'\n    fi\n    case $command in\n");
        for (size_t i = 0; i < c->count; i++) {
            buffer_printf(out, "    %s)\n", c->commands[i].name);
            put_command(out, &c->commands[i], "        ");
            buffer_puts(out, " ;;\n");
        }
        buffer_puts(out, "    esac\n");
    } else if (c->count > 0) {
        put_command(out, &c->commands[0], "    ");
        buffer_puts(out, "\n");
    }
    buffer_printf(out, "%s}\ncomplete -F _", tail);
    completion_put_function(c, out);
    buffer_printf(out, " %s\n", c->program);
}
