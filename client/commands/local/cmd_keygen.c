/* azulejo keygen: make a farm's key, or derive a role's key from it. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "client/commands/command.h"
#include "client/terminal/must.h"
#include "common/base/buffer.h"
#include "protocol/key.h"

static status write_new_file(const char *path, const struct buffer *text, struct error *err)
{
    /* Never overwrite a file: a farm that loses its key loses its workers. */
    int fd = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    status result = STATUS_OK;

    if (fd < 0)
        return error_set(err, STATUS_ERR_IO, "%s: cannot be made: %s", path, strerror(errno));
    if (write(fd, text->data, text->size) != (ssize_t)text->size || fsync(fd) != 0)
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
    if (close(fd) != 0 && result == STATUS_OK)
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", path, strerror(errno));
    if (result != STATUS_OK)
        unlink(path);
    return result;
}

status command_write_key(const struct farm_key *key, const char *output, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status result = STATUS_OK;

    farm_key_print(key, &text);
    must_hold(&text);
    if (output)
        result = write_new_file(output, &text, err);
    else
        fputs(buffer_text(&text), stdout);
    buffer_wipe(&text);
    return result;
}

static enum farm_role role_of(const char *name)
{
    for (int role = FARM_ROLE_WORKER; role < FARM_ROLE_COUNT; role++)
        if (strcmp(farm_role_name((enum farm_role)role), name) == 0)
            return (enum farm_role)role;
    return FARM_ROLE_NONE;
}

static status run(const struct command *command, int argc, char *const *argv, int *exit_code UNUSED, struct error *err)
{
    const char *role = NULL, *from = NULL, *output = NULL;
    const struct option table[] = {
        {"role", 'r', OPTION_CHOICE, &role, "ROLE", "derive the key of one role (needs --from)", 0,
         0, "worker|client|admin|web"},
        {"from", 0, OPTION_STRING, &from, "FILE", "the farm's key, to derive from", 0, 0, NULL},
        {"output", 'o', OPTION_STRING, &output, "FILE",
         "write a new file that only its owner can read, instead of standard output", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    struct farm_key key, derived;
    int done;
    status result = command_parse(command, table, argc, argv, 0, 0, &rest, &done, err);

    if (result != STATUS_OK || done)
        return result;
    if (!role != !from)
        return error_set(err, STATUS_ERR_USAGE,
                         "--role and --from go together: a role's key is derived from the farm's");
    if (from) {
        result = farm_key_load(&key, from, err);
        if (result == STATUS_OK && !key.is_farm)
            result =
                error_set(err, STATUS_ERR_INPUT, "%s: holds a role's key; only the farm's key can derive others", from);
        THEN(result, farm_key_derive(&key, role_of(role), &derived, err));
    } else {
        result = farm_key_generate(&derived, err);
    }
    THEN(result, command_write_key(&derived, output, err));
    explicit_bzero(&key, sizeof key);
    explicit_bzero(&derived, sizeof derived);
    return result;
}

const struct command command_keygen = {
    .name = "keygen",
    .group = COMMAND_FARM,
    .usage = "azulejo keygen [-o FILE] [--role ROLE --from FARM_KEY]",
    .summary = "make a farm's key, or one that all of a role share",
    .description =
        "Make a new farm key, which the coordinator needs and which opens every door, or derive from it the key that all\n"
        "of one role share: a worker's key cannot submit jobs, a client's cannot render. It cannot be revoked: 'azulejo\n"
        "key new' makes keys of single people and machines.",
    .run = run,
};
