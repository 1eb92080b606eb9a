#include "client/link/connection.h"
#include "client/terminal/must.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/base/buffer.h"
#include "protocol/address.h"

static status key_path_default(struct buffer *path, struct error *err)
{
    const char *named = getenv("AZULEJO_KEY");
    const char *config = getenv("XDG_CONFIG_HOME");
    const char *home = getenv("HOME");

    if (named && *named)
        buffer_puts(path, named);
    else if (config && *config == '/')
        buffer_printf(path, "%s/azulejo/farm.key", config);
    else if (home && *home)
        buffer_printf(path, "%s/.config/azulejo/farm.key", home);
    else
        return error_set(err, STATUS_ERR_USAGE, "no key: name its file with --key or AZULEJO_KEY");
    must_hold(path);
    return STATUS_OK;
}

static status key_load(struct farm_key *key, const char *path, struct error *err)
{
    struct buffer name = BUFFER_INIT;
    status result = STATUS_OK;

    if (path)
        buffer_puts(&name, path);
    else
        result = key_path_default(&name, err);
    THEN(result, farm_key_load(key, buffer_text(&name), err));
    if (result != STATUS_OK && !path && !getenv("AZULEJO_KEY") && err) {
        size_t used = strlen(err->text);
        snprintf(err->text + used, sizeof err->text - used, " (name the farm's key file with --key or AZULEJO_KEY)");
    }
    buffer_release(&name);
    return result;
}

status connection_options_resolve(const struct connection_options *options, char host[CONNECTION_HOST_MAX],
                                  uint16_t *port, struct farm_key *key, struct error *err)
{
    const char *address = options->coordinator;

    if (!address)
        address = getenv("AZULEJO_COORDINATOR");
    if (!address || !*address)
        address = "127.0.0.1";
    TRY(address_parse(address, "127.0.0.1", 1, host, CONNECTION_HOST_MAX, port, err));
    return key_load(key, options->key_path, err);
}
