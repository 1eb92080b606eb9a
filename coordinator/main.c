/* azulejo-coordinator: the daemon that owns the queue, the films and the outputs. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/accuracy/stop.h"
#include "common/base/clock.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/options.h"
#include "coordinator/store/blobs.h"
#include "coordinator/net/descriptors.h"
#include "coordinator/net/server.h"
#include "coordinator/store/store.h"
#include "protocol/address.h"
#include "protocol/key.h"

static status load_key(const char *path, struct farm_key *key, struct error *err)
{
    const char *named = path ? path : getenv("AZULEJO_KEY");
    status s;

    if (!named || !named[0])
        return error_set(
            err, STATUS_ERR_USAGE,
            "no key: name the farm's key file with --key or AZULEJO_KEY (azulejo keygen "
            "makes one)");
    s = farm_key_load(key, named, err);
    if (s == STATUS_OK && !key->is_farm)
        s = error_set(err, STATUS_ERR_REFUSED,
                      "%s: holds the %s role's key; the coordinator needs the farm's own key",
                      named, farm_role_name(key->role));
    return s;
}

/* "off" is 0. */
static status parse_length(const char *option, const char *text, double usual_s, double *out_s,
                           struct error *err)
{
    uint64_t ms = 0;
    status s = STATUS_OK;

    *out_s = usual_s;
    if (!text)
        return STATUS_OK;
    if (strcmp(text, "off") != 0)
        s = stop_duration_parse(option, text, &ms, err);
    *out_s = (double)ms / 1000;
    return s;
}

static int fail(const struct error *err)
{
    fprintf(stderr, "azulejo-coordinator: %s\n", err->text);
    return status_exit_code(err->code);
}

int main(int argc, char **argv)
{
    const char *listen = "127.0.0.1:7420", *key_path = NULL, *folder = "azulejo-store";
    const char *level = "info", *ready_file = NULL, *precision = "float";
    const char *half_life = NULL, *longest_wait = NULL;
    double lease_seconds = 60;
    int remove_store = 0, version = 0, help = 0;
    const struct option table[] = {
        {"listen", 'l', OPTION_STRING, &listen, "HOST:PORT",
         "address to listen on (127.0.0.1:7420); port 0 takes any free one", 0, 0, NULL},
        {"key", 'k', OPTION_STRING, &key_path, "FILE", "the farm's key file (AZULEJO_KEY)", 0, 0,
         NULL},
        {"store", 's', OPTION_STRING, &folder, "DIR",
         "where jobs, blobs and pictures are kept (azulejo-store)", 0, 0, NULL},
        {"lease-seconds", 0, OPTION_REAL, &lease_seconds, "S",
         "after this long without a result, a worker's lease goes to other workers (60)", 1, 86400, NULL},
        {"half-life", 0, OPTION_STRING, &half_life, "TIME",
         "an owner's core-seconds count half after this time, as in 8h, when owners of equal priority share the "
         "farm; off: first come, first served (8h)", 0, 0, NULL},
        {"longest-wait", 0, OPTION_STRING, &longest_wait, "TIME",
         "an owner whose jobs were lent nothing for this long gets a turn before others of its priority; off: "
         "never (1h)", 0, 0, NULL},
        {"ready-file", 0, OPTION_STRING, &ready_file, "FILE",
         "write the port there, atomically, once connections are accepted", 0, 0, NULL},
        {"remove-store-at-end", 0, OPTION_FLAG, &remove_store, NULL,
         "a temporary store: on SIGTERM or SIGINT, remove its folder and everything in it", 0, 0,
         NULL},
        {"precision", 0, OPTION_CHOICE, &precision, "NAME",
         "what its workers compute in (float); double ones are built with DOUBLE=1", 0, 0, "float|double"},
        {"log-level", 0, OPTION_CHOICE, &level, "LEVEL", "what is logged (info)", 0, 0,
         "error|warn|info|debug"},
        {"version", 0, OPTION_FLAG, &version, NULL, "print the version", 0, 0, NULL},
        {0},
    };
    struct server_options options = {0};
    struct positionals rest;
    struct farm_key key = {0};
    struct store *store = NULL;
    struct error err = {0};
    char host[ADDRESS_HOST_MAX];
    status s;

    file_hold_standard();
    s = options_parse(table, argc, argv, &rest, &help, &err);
    if (s == STATUS_OK && help) {
        options_print_help("azulejo-coordinator --key FILE [options]",
                           "Own the queue of a render farm: lend work to workers, merge what they "
                           "send, write the pictures.",
                           table);
        return 0;
    }
    if (s == STATUS_OK && version) {
        printf("azulejo-coordinator " AZULEJO_VERSION "\n");
        return 0;
    }
    if (s == STATUS_OK && rest.count > 0)
        s = error_set(&err, STATUS_ERR_USAGE, "unexpected argument '%s'", rest.items[0]);
    if (s == STATUS_OK)
        s = address_parse(listen, "", 0, host, sizeof host, &options.port, &err);
    if (s == STATUS_OK)
        s = parse_length("--half-life", half_life, ORDER_HALF_LIFE_S, &options.order.half_life_s, &err);
    if (s == STATUS_OK)
        s = parse_length("--longest-wait", longest_wait, ORDER_LONGEST_WAIT_S, &options.order.longest_wait_s, &err);
    if (s == STATUS_OK)
        s = load_key(key_path, &key, &err);
    if (s != STATUS_OK)
        return fail(&err);
    log_setup("azulejo-coordinator", (enum log_level)log_level_parse(level));
    signal(SIGPIPE, SIG_IGN);
    s = store_open(&store, folder, &err);
    if (s == STATUS_OK)
        s = descriptors_plan(&options.descriptors, &err);
    if (s == STATUS_OK) {
        blobs_clean(folder);
        options.host = host;
        options.key = &key;
        options.store = store;
        options.lease_ns = (uint64_t)(lease_seconds * 1e9);
        options.ready_file = ready_file;
        options.discards_films = remove_store;
        options.precision = precision;
        s = server_run(&options, &err);
    }
    store_close(store);
    explicit_bzero(&key, sizeof key);
    if (s != STATUS_OK)
        return fail(&err);
    if (remove_store)
        file_remove_tree(folder);
    log_info("ended");
    return 0;
}
