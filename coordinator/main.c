/* azulejo-coordinator: the daemon that owns the queue, the films and the outputs. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <uv.h>

#include "common/base/bytes_text.h"
#include "common/base/duration.h"
#include "common/base/memory.h"
#include "common/cli/completion.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/cli/options.h"
#include "coordinator/store/files/blobs.h"
#include "coordinator/net/descriptors.h"
#include "coordinator/net/base/task.h"
#include "coordinator/net/server.h"
#include "coordinator/store/store.h"
#include "coordinator/store/store_backup.h"
#include "coordinator/store/store_rot.h"
#include "coordinator/page/keeper.h"
#ifdef AZULEJO_WEB
#include "coordinator/page/page.h"
#endif
#include "protocol/address.h"
#include "protocol/key.h"

static status load_key(const char *path, struct farm_key *key, struct error *err)
{
    const char *named = path ? path : getenv("AZULEJO_KEY");
    char words[KEY_WORDS_SIZE];

    if (!named || !named[0])
        return error_set(err, STATUS_ERR_USAGE,
                         "no key: name the farm's key file with --key or AZULEJO_KEY (azulejo keygen "
                         "makes one)");
    TRY(farm_key_load(key, named, err));
    if (!key->is_farm)
        TRY(error_set(err, STATUS_ERR_REFUSED, "%s: holds the %s; the coordinator needs the farm's own key", named,
                      key_identity_words(&key->id, words)));
    return STATUS_OK;
}

/* A size, or a share of the disk; NULL: not given. */
static status parse_limit(const char *option, const char *text, struct room_limit *limit, struct error *err)
{
    char *end;
    double percent;

    if (!text)
        return STATUS_OK;
    percent = strtod(text, &end);
    if (end != text && strcmp(end, "%") == 0 && percent > 0 && percent <= 100) {
        limit->share = percent / 100;
        return STATUS_OK;
    }
    if (options_size_parse(text, &limit->bytes) == STATUS_OK && limit->bytes > 0)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_USAGE,
                     "%s: '%s' is neither a size (a number with K, M, G or T) nor a share (1%% to 100%%)", option, text);
}

static status retention_options(const char *keep, const char *keep_failed, const char *keep_blobs, const char *age_wait,
                                const char *store_limit, const char *submit_jobs, struct retention_policy *policy,
                                struct error *err)
{
    status s = STATUS_OK;

    if (keep)
        s = duration_parse("--keep", keep, &policy->keep_s, err);
    if (s == STATUS_OK && keep_failed)
        s = duration_parse("--keep-failed", keep_failed, &policy->keep_failed_s, err);
    if (s == STATUS_OK && keep_blobs)
        s = duration_parse("--keep-blobs", keep_blobs, &policy->keep_blobs_s, err);
    if (s == STATUS_OK && age_wait)
        s = duration_parse("--age-wait", age_wait, &policy->age_wait_s, err);
    THEN(s, parse_limit("--store-limit", store_limit, &policy->store, err));
    THEN(s, parse_limit("--submit-jobs", submit_jobs, &policy->submit, err));
    return s;
}

/* "off" is 0. */
static status parse_length(const char *option, const char *text, double usual_s, double *out_s, struct error *err)
{
    int64_t seconds = 0;
    status s = STATUS_OK;

    *out_s = usual_s;
    if (!text)
        return STATUS_OK;
    if (strcmp(text, "off") != 0)
        s = duration_parse(option, text, &seconds, err);
    *out_s = (double)seconds;
    return s;
}

static int fail(const struct error *err)
{
    if (log_is_json())
        log_error("%s", err->text);
    else
        fprintf(stderr, "azulejo-coordinator: %s\n", err->text);
    return status_exit_code(err->code);
}

/* The commands `backup` and `restore`. */
static int copy_store(const char *command, const char *dir, const char *folder)
{
    int restores = strcmp(command, "restore") == 0;
    char text[BYTES_TEXT_SIZE];
    struct copied sum;
    struct error err = {0};
    status s;

    log_setup("azulejo-coordinator", LOG_LEVEL_WARN);
    s = restores ? store_restore(dir, folder, &sum, &err) : store_backup(folder, dir, &sum, &err);
    if (s != STATUS_OK)
        return fail(&err);
    printf("%s: %llu files, %s\n", restores ? folder : dir, (unsigned long long)sum.files, bytes_text(text, sum.bytes));
    return 0;
}

static void say_line(const char *line) { printf("%s\n", line); }

/* --check, with or without --repair. */
static int check_store(const char *folder, int repair)
{
    struct error err = {0};
    struct rot rot;
    status s = store_rot_check(folder, repair, say_line, &rot, &err);

    if (s != STATUS_OK)
        return fail(&err);
    printf("%s: %llu files, %llu fault%s\n", folder, (unsigned long long)rot.files, (unsigned long long)rot.faults,
           rot.faults == 1 ? "" : "s");
    return rot.faults > 0 && !repair ? status_exit_code(STATUS_ERR_CORRUPT) : 0;
}

#ifdef AZULEJO_WEB

static int names_port(const char *address)
{
    const char *bracket = strchr(address, ']'), *colon = strchr(bracket ? bracket : address, ':');

    return colon && !strchr(colon + 1, ':');
}

/* The page's options: what --web says, or the port above the farm's. `host` holds the address's text. */
static status page_prepare(struct page_options *page, const char *address, uint16_t farm_port, char *host,
                           size_t host_size, struct error *err)
{
    const char *named = address ? address : "127.0.0.1";
    const int has_port = names_port(named);
    status s;

    page->host = host;
    page->was_asked_for = address != NULL;
    s = address_parse(named, "", 0, host, host_size, &page->port, err);
    if (s == STATUS_OK && !has_port)
        page->port = farm_port && farm_port < UINT16_MAX ? (uint16_t)(farm_port + 1) : 0;
    if (s == STATUS_OK && !page->cert != !page->key)
        s = error_set(err, STATUS_ERR_USAGE, "--web-cert and --web-key belong together: name both files");
    return s;
}

static uint32_t page_connections(int off) { return off ? 0 : PAGE_CONNECTIONS_MAX; }

/* Run the farm, with its page unless `off`. */
static status run(struct server_options *options, struct page_options *page, const char *address, int off,
                  struct error *err)
{
    char host[ADDRESS_HOST_MAX];
    struct page *parts = NULL;
    status s = STATUS_OK;

    if (!off)
        s = page_prepare(page, address, options->port, host, sizeof host, err);
    if (s == STATUS_OK && !off) {
        page->connections_max = options->descriptors.guests_max;
        page->address_max = descriptors_of_address(page->connections_max, options->descriptors.address_max);
        s = page_new(&parts, page, err);
        options->guest = page_guest(parts);
    }
    THEN(s, server_run(options, err));
    page_free(parts);
    return s;
}

#else

static uint32_t page_connections(int off UNUSED) { return 0; }

static status run(struct server_options *options, const struct page_options *page, const char *address, int off UNUSED,
                  struct error *err)
{
    if (address || page->name || page->cert || page->key || page->client || page->is_apart)
        return error_set(err, STATUS_ERR_USAGE,
                         "this build has no page: build it with libwebsockets-dev installed and without WEB=0");
    return server_run(options, err);
}

#endif

static void on_second_signal(uv_signal_t *handle UNUSED, int number UNUSED) {}

/* The server takes the first signal. These handles, in a loop that never runs, keep libuv's handler when the server's
 * are closed, so that another signal does not cut off the end: the store is closed and perhaps removed then. A parent
 * of several threads that is killed makes the kernel send two. */
static void outlast_signals(void)
{
    static uv_signal_t handles[2];
    static const int numbers[2] = {SIGTERM, SIGINT};

    for (int i = 0; i < 2; i++)
        if (uv_signal_init(uv_default_loop(), &handles[i]) == 0)
            (void)!uv_signal_start(&handles[i], on_second_signal, numbers[i]);
}

int main(int argc, char **argv)
{
    const char *listen = "127.0.0.1:7420", *key_path = NULL, *folder = "azulejo-store";
    const char *keep = NULL, *keep_failed = NULL, *keep_blobs = NULL, *age_wait = NULL, *store_limit = NULL,
               *submit_jobs = NULL;
    const char *level = "info", *log_format = NULL, *completion = NULL, *ready_file = NULL, *precision = "float";
    struct server_options options = {.policy = RETENTION_POLICY_DEFAULT, .scrub_rate = SCRUB_RATE_DEFAULT};
    const char *half_life = NULL, *longest_wait = NULL;
    double lease_seconds = 60, unit_seconds = HANG_LEAST_S;
    int64_t per_address = 0;
    const char *web = NULL;
    struct page_options page = {0};
    int remove_store = 0, check = 0, repair = 0, no_web = 0, version = 0, help = 0;
    const struct option table[] = {
        {"listen", 'l', OPTION_STRING, &listen, "HOST:PORT",
         "address to listen on, or a name for all of its addresses (127.0.0.1:7420); port 0 takes any free one", 0, 0, NULL},
        {"key", 'k', OPTION_STRING, &key_path, "FILE", "the farm's key file (AZULEJO_KEY)", 0, 0,
         NULL},
        {"store", 's', OPTION_STRING, &folder, "DIR",
         "where jobs, blobs and pictures are kept (azulejo-store)", 0, 0, NULL},
        {"lease-seconds", 0, OPTION_REAL, &lease_seconds, "S",
         "after this long without a result, a worker's lease goes to other workers (60)", 1, 86400, NULL},
        {"keep", 0, OPTION_STRING, &keep, "TIME",
         "remove jobs, with their films and pictures, so long after their end, as in 30d (default: never)", 0, 0, NULL},
        {"keep-failed", 0, OPTION_STRING, &keep_failed, "TIME",
         "the same for jobs that failed or were cancelled (default: as --keep)", 0, 0, NULL},
        {"keep-blobs", 0, OPTION_STRING, &keep_blobs, "TIME",
         "remove scenes and their files that no job needs, so long after a client named them last (1d)", 0, 0, NULL},
        {"age-wait", 0, OPTION_STRING, &age_wait, "TIME",
         "nothing is removed by age before the clock went evenly for so long, after a start and after a jump (1h)", 0, 0, NULL},
        {"store-limit", 0, OPTION_STRING, &store_limit, "SIZE",
         "above this (500G, or 80% of the disk) remove films, then pictures, of the jobs that ended first (default: no limit)",
         0, 0, NULL},
        {"owner-limit", 0, OPTION_SIZE, &options.policy.owner_limit, "SIZE",
         "the same for the films and pictures of each owner's jobs (default: no limit)", 0, 0, NULL},
        {"submit-blobs", 0, OPTION_SIZE, &options.submit_blobs, "SIZE",
         "so much may a token of the role submit send that no job needs (16G)", 0, 0, NULL},
        {"submit-jobs", 0, OPTION_STRING, &submit_jobs, "SIZE",
         "so much, or such a share of the disk, may the jobs of an owner with the role submit take, scenes included (50%)", 0, 0,
         NULL},
        {"unit-seconds", 0, OPTION_REAL, &unit_seconds, "S",
         "a work unit hangs when it is rendered for this long, and 20 times what the slowest of its size took (60)",
         0.01, 86400, NULL},
        {"scrub-rate", 0, OPTION_SIZE, &options.scrub_rate, "SIZE",
         "bytes a second that are read to find damage in the store while nothing is rendered (16M); 0: none", 0, 0, NULL},
        {"no-audits", 0, OPTION_FLAG, &options.no_audits, NULL,
         "do not render a share of the results again on other workers to find those that are wrong", 0, 0, NULL},
        {"no-shared-keys", 0, OPTION_FLAG, &options.no_shared_keys, NULL,
         "take keys of names only (azulejo key), not those that all of a role share (azulejo keygen --role)", 0, 0, NULL},
        {"half-life", 0, OPTION_STRING, &half_life, "TIME",
         "an owner's core-seconds count half after this time, as in 8h, when owners of equal priority share the "
         "farm; off: first come, first served (8h)", 0, 0, NULL},
        {"longest-wait", 0, OPTION_STRING, &longest_wait, "TIME",
         "an owner whose jobs were lent nothing for this long gets a turn before others of its priority; off: "
         "never (1h)", 0, 0, NULL},
        {"web", 0, OPTION_STRING, &web, "HOST:PORT",
         "address of the page and its API (127.0.0.1 and the port after that of --listen); beyond this machine only "
         "over TLS", 0, 0, NULL},
        {"no-web", 0, OPTION_FLAG, &no_web, NULL, "no page and no API", 0, 0, NULL},
        {"web-apart", 0, OPTION_FLAG, &page.is_apart, NULL,
         "do not start the page's program: one that was started by hand connects (azulejo-web)", 0, 0, NULL},
        {"web-name", 0, OPTION_STRING, &page.name, "NAME",
         "one more name by which browsers reach the page", 0, 0, NULL},
        {"web-cert", 0, OPTION_STRING, &page.cert, "FILE",
         "the page's certificate, with its chain, in PEM (one made on first use, in the store)", 0, 0, NULL},
        {"web-key", 0, OPTION_STRING, &page.key, "FILE", "the certificate's key, in PEM", 0, 0, NULL},
        {"client-program", 0, OPTION_STRING, &page.client, "FILE",
         "the program that reads scenes which are uploaded to the page (azulejo, beside this one)", 0, 0, NULL},
        {"on-event", 0, OPTION_STRING, &options.on_event, "PROGRAM",
         "run it for each job that is done, failed or parked, and when the store cannot be used, with JSON on its standard input", 0, 0, NULL},
        {"connections-per-address", 0, OPTION_INT, &per_address, "N",
         "sessions, and connections of the page, that one address may have (three quarters of all, so that others get in)",
         1, SESSIONS_MAX, NULL},
        {"ready-file", 0, OPTION_STRING, &ready_file, "FILE",
         "write the port there, atomically, once connections are accepted", 0, 0, NULL},
        {"check", 0, OPTION_FLAG, &check, NULL,
         "look through the --store, which no coordinator may use, for what is damaged: a line each, with the remedy; then end",
         0, 0, NULL},
        {"repair", 0, OPTION_FLAG, &repair, NULL, "with --check: mend it, so that a coordinator starts", 0, 0, NULL},
        {"remove-store-at-end", 0, OPTION_FLAG, &remove_store, NULL,
         "a temporary store: on SIGTERM or SIGINT, remove its folder and everything in it", 0, 0,
         NULL},
        {"precision", 0, OPTION_CHOICE, &precision, "NAME",
         "what its workers compute in (float); double ones are built with DOUBLE=1", 0, 0, "float|double"},
        {"log-level", 0, OPTION_CHOICE, &level, "LEVEL", "what is logged (info)", 0, 0,
         "error|warn|info|debug"},
        {"log-format", 0, OPTION_CHOICE, &log_format, "FORM",
         "lines of text, or JSON, an object a line (default $AZULEJO_LOG_FORMAT, else text)", 0, 0, "text|json"},
        {"completion", 0, OPTION_CHOICE, &completion, "SHELL",
         "print a script that completes command lines in a shell", 0, 0, COMPLETION_SHELLS},
        {"version", 0, OPTION_FLAG, &version, NULL, "print the version", 0, 0, NULL},
        {0},
    };
    struct positionals rest;
    struct farm_key key = {0};
    struct store *store = NULL;
    struct error err = {0};
    char host[ADDRESS_HOST_MAX];
    status s;

    file_hold_standard();
    mem_keep();
    log_setup("azulejo-coordinator", LOG_LEVEL_INFO);
    s = options_parse(table, argc, argv, &rest, &help, &err);
    THEN(s, log_set_format(log_format, &err));
    if (s == STATUS_OK && help) {
        options_print_help("azulejo-coordinator --key FILE [options]\n"
                           "       azulejo-coordinator backup|restore DIR --store DIR\n"
                           "       azulejo-coordinator --check [--repair] --store DIR",
                           "Own the queue of a render farm: lend work to workers, merge what they "
                           "send, write the pictures. With backup, copy a store to a new folder, also while its "
                           "coordinator runs; with restore, make a store of such a copy.",
                           table);
        return 0;
    }
    if (s == STATUS_OK && version) {
        printf("azulejo-coordinator " AZULEJO_VERSION "\n");
        return 0;
    }
    if (s == STATUS_OK && rest.count == 2 &&
        (strcmp(rest.items[0], "backup") == 0 || strcmp(rest.items[0], "restore") == 0))
        return copy_store(rest.items[0], rest.items[1], folder);
    if (s == STATUS_OK && repair && !check)
        s = error_set(&err, STATUS_ERR_USAGE, "--repair belongs to --check");
    if (s == STATUS_OK && check) {
        log_setup("azulejo-coordinator", LOG_LEVEL_ERROR);
        return check_store(folder, repair);
    }
    if (s == STATUS_OK && completion) {
        s = completion_print("azulejo-coordinator", completion, "azulejo-coordinator --key FILE [options]", table, &err);
        return s == STATUS_OK && fflush(stdout) == 0 ? 0 : status_exit_code(STATUS_ERR_IO);
    }
    if (s == STATUS_OK && rest.count > 0)
        s = error_set(&err, STATUS_ERR_USAGE, "unexpected argument '%s': only 'backup DIR' and 'restore DIR' are known",
                      rest.items[0]);
    THEN(s, address_parse(listen, "", 0, host, sizeof host, &options.port, &err));
    THEN(s, retention_options(keep, keep_failed, keep_blobs, age_wait, store_limit, submit_jobs, &options.policy, &err));
    THEN(s, parse_length("--half-life", half_life, ORDER_HALF_LIFE_S, &options.order.half_life_s, &err));
    THEN(s, parse_length("--longest-wait", longest_wait, ORDER_LONGEST_WAIT_S, &options.order.longest_wait_s, &err));
    THEN(s, load_key(key_path, &key, &err));
    if (s != STATUS_OK)
        return fail(&err);
    if (remove_store)
        file_forgo_syncs();
    log_setup("azulejo-coordinator", (enum log_level)log_level_parse(level));
    signal(SIGPIPE, SIG_IGN);
    s = task_threads(&err);
    THEN(s, store_open(&store, folder, &err));
    THEN(s, descriptors_plan(&options.descriptors, page_connections(no_web), &err));
    options.descriptors.address_max = (uint32_t)per_address;
    if (s == STATUS_OK) {
        blobs_clean(folder);
        options.host = host;
        options.key = &key;
        options.store = store;
        options.lease_ns = (uint64_t)(lease_seconds * 1e9);
        options.hang_ns = (uint64_t)(unit_seconds * 1e9);
        options.ready_file = ready_file;
        options.discards_films = remove_store;
        options.precision = precision;
        page.store = folder;
        page.log_level = level;
        outlast_signals();
        s = run(&options, &page, web, no_web, &err);
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
