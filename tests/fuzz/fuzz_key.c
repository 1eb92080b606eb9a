/* A key's identity, as a stranger names it in TLS, and a key file's text, on any bytes: what is taken has one text. */
#include <stdlib.h>
#include <string.h>

#include "protocol/key.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void try_identity(const uint8_t *data, size_t size)
{
    char text[KEY_IDENTITY_SIZE];
    struct key_identity id;

    if (!key_identity_parse(&id, data, size))
        return;
    (void)key_identity_print(&id, text);
    if (strlen(text) != size || memcmp(text, data, size) != 0)
        abort();
}

static void try_file(const uint8_t *data, size_t size)
{
    struct buffer text = BUFFER_INIT;
    struct farm_key key, again;
    struct error err = {0};

    if (farm_key_parse(&key, (const char *)data, size, "key", &err) != STATUS_OK) {
        if (!err.text[0])
            abort(); /* every refusal says why */
        return;
    }
    farm_key_print(&key, &text);
    if (!buffer_ok(&text) || farm_key_parse(&again, buffer_text(&text), text.size, "key", NULL) != STATUS_OK ||
        !key_identity_equal(&key.id, &again.id) || memcmp(key.secret, again.secret, sizeof key.secret) != 0)
        abort();
    buffer_release(&text);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size > FARM_KEY_FILE_MAX)
        return 0;
    try_identity(data, size);
    try_file(data, size);
    return 0;
}
