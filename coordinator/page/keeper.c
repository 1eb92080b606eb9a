#include "coordinator/page/keeper.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "common/base/buffer.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "coordinator/net/server.h"
#include "protocol/key.h"

enum { PATH_BYTES = 4096, WORDS_MAX = 40, NUMBER_SIZE = 24, ADDRESS_SIZE = 320, KEY_FD = 3 };

struct keeper {
    struct server *server;
    const struct page_options *options;
    char *program;
    uv_process_t process;
    uv_timer_t timer;     /* to the next start, to its PageBegin, and to a SIGKILL */
    int runs, is_stopped; /* runs: the process's handle is open */
    int was_running;      /* it listened once, on: */
    uint16_t port;
    uint32_t wait_ms, killed; /* killed: how often, before it ever listened */
    uint64_t begun_ns;
    struct error why; /* it gave up */
};

static void start(struct keeper *keeper);

/* The program's path, beside this program's. NULL: out of memory. */
static char *program_path(void)
{
    char path[PATH_BYTES];
    ssize_t length = readlink("/proc/self/exe", path, sizeof path - 1);
    char *folder, *out;

    if (length <= 0)
        return mem_strdup("azulejo-web");
    path[length] = 0;
    folder = file_dirname(path);
    out = folder ? file_join(folder, "azulejo-web") : NULL;
    mem_free(folder);
    return out;
}

/* ---- what it gets ------------------------------------------------------------------------------ */

/* A descriptor with the key, that only the program gets. -1: *err. */
static int make_secret(const struct farm_key *farm, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    struct farm_key key;
    int fd = memfd_create("azulejo-key", MFD_CLOEXEC);
    status s = farm_key_derive(farm, FARM_ROLE_WEB, &key, err);

    if (s == STATUS_OK)
        farm_key_print(&key, &text);
    if (s == STATUS_OK &&
        (fd < 0 || fchmod(fd, 0600) != 0 || !buffer_ok(&text) || write(fd, text.data, text.size) != (ssize_t)text.size))
        s = error_set(err, STATUS_ERR_IO, "no memory file for a key: %s", strerror(errno));
    explicit_bzero(&key, sizeof key);
    buffer_wipe(&text);
    if (s != STATUS_OK && fd >= 0) {
        close(fd);
        fd = -1;
    }
    return fd;
}

/* Where this machine's programs reach the coordinator. */
static void own_address(const struct server *server, char out[ADDRESS_TEXT_SIZE])
{
    const char *name = server->sockets.names[0];

    if (strncmp(name, "[::]:", 5) == 0)
        snprintf(out, ADDRESS_TEXT_SIZE, "[::1]:%s", name + 5);
    else if (strncmp(name, "0.0.0.0:", 8) == 0)
        snprintf(out, ADDRESS_TEXT_SIZE, "127.0.0.1:%s", name + 8);
    else
        snprintf(out, ADDRESS_TEXT_SIZE, "%s", name);
}

/* The texts of the command line. */
struct words {
    const char *all[WORDS_MAX];
    size_t count;
    char coordinator[ADDRESS_TEXT_SIZE], listen[ADDRESS_SIZE], parent[NUMBER_SIZE], connections[NUMBER_SIZE], each[NUMBER_SIZE];
};

static void add(struct words *words, const char *option, const char *value)
{
    if (!value || words->count + 3 > WORDS_MAX)
        return;
    words->all[words->count++] = option;
    words->all[words->count++] = value;
}

static void make_words(const struct keeper *keeper, struct words *words)
{
    const struct page_options *o = keeper->options;
    uint16_t port = keeper->port ? keeper->port : o->port;

    memset(words, 0, sizeof *words);
    own_address(keeper->server, words->coordinator);
    snprintf(words->listen, sizeof words->listen, strchr(o->host, ':') ? "[%s]:%u" : "%s:%u", o->host, port);
    snprintf(words->parent, sizeof words->parent, "%d", (int)uv_os_getpid());
    snprintf(words->connections, sizeof words->connections, "%" PRIu32, o->connections_max);
    snprintf(words->each, sizeof words->each, "%" PRIu32, o->address_max);
    words->all[words->count++] = "azulejo-web";
    add(words, "--coordinator", words->coordinator);
    add(words, "--key", "/proc/self/fd/3");
    add(words, "--web", words->listen);
    add(words, "--folder", o->store);
    add(words, "--parent", words->parent);
    add(words, "--connections", words->connections);
    add(words, "--connections-per-address", words->each);
    add(words, "--web-name", o->name);
    add(words, "--web-cert", o->cert);
    add(words, "--web-key", o->key);
    add(words, "--client-program", o->client);
    add(words, "--log-level", o->log_level);
    add(words, "--log-format", log_is_json() ? "json" : "text");
}

/* ---- its life ---------------------------------------------------------------------------------- */

static void on_start_time(uv_timer_t *timer) { start(timer->data); }

/* The first one: the loop wakes and asks keeper_gave_up. */
static void on_late(uv_timer_t *timer)
{
    struct keeper *keeper = timer->data;

    if (keeper->was_running)
        keeper_hung(keeper);
}

/* It ended, or could not be run: choose how long the next start waits. Returns it in seconds. */
static double choose_wait(struct keeper *keeper)
{
    uint64_t ran_ms = (clock_monotonic_ns() - keeper->begun_ns) / NS_PER_MS;

    keeper->wait_ms = ran_ms >= KEEPER_STEADY_MS || keeper->wait_ms == 0 ? KEEPER_WAIT_MIN_MS
                      : 2 * keeper->wait_ms < KEEPER_WAIT_MAX_MS        ? 2 * keeper->wait_ms
                                                                         : KEEPER_WAIT_MAX_MS;
    return keeper->wait_ms / 1e3;
}

static void again(struct keeper *keeper)
{
    if (!keeper->is_stopped && keeper->why.code == STATUS_OK)
        uv_timer_start(&keeper->timer, on_start_time, keeper->wait_ms, 0);
}

static void on_process_closed(uv_handle_t *handle)
{
    struct keeper *keeper = handle->data;

    keeper->runs = 0;
    if (!keeper->is_stopped)
        again(keeper);
    else if (!uv_is_closing((uv_handle_t *)&keeper->timer))
        uv_close((uv_handle_t *)&keeper->timer, NULL);
}

static void on_exit_(uv_process_t *process, int64_t exit_status, int number)
{
    struct keeper *keeper = process->data;
    const double wait_s = choose_wait(keeper);
    char how[64];

    snprintf(how, sizeof how, number ? "signal %" PRId64 : "status %" PRId64, number ? (int64_t)number : exit_status);
    if (!keeper->is_stopped && keeper->was_running)
        log_warn("the page's program azulejo-web has ended (%s): it is started again in %g s; jobs continue", how, wait_s);
    else if (!keeper->is_stopped && number && keeper->killed++ < KEEPER_KILLED_MAX)
        log_warn("the page's program azulejo-web ended before it listened (%s): it is started again in %g s", how, wait_s);
    else if (!keeper->is_stopped)
        error_set(&keeper->why, STATUS_ERR_IO, "the page's program azulejo-web ended before it listened (%s)", how);
    uv_close((uv_handle_t *)process, on_process_closed);
}

static int spawn(struct keeper *keeper, const struct words *words, int secret)
{
    uv_stdio_container_t stdio[KEY_FD + 1] = {{.flags = UV_IGNORE}, {.flags = UV_IGNORE}, {.flags = UV_INHERIT_FD},
                                              {.flags = UV_INHERIT_FD}};
    uv_process_options_t how = {.file = keeper->program, .args = (char **)(uintptr_t)words->all, /* libuv only reads them */
                                .stdio = stdio, .stdio_count = KEY_FD + 1, .exit_cb = on_exit_};

    stdio[STDERR_FILENO].data.fd = STDERR_FILENO;
    stdio[KEY_FD].data.fd = secret;
    keeper->process.data = keeper;
    return uv_spawn(&keeper->server->loop, &keeper->process, &how);
}

static void start(struct keeper *keeper)
{
    struct error err = {0};
    struct words words;
    int secret = make_secret(keeper->server->key, &err), code = 0;

    uv_timer_start(&keeper->timer, on_late, KEEPER_START_MS + 1, 0);
    make_words(keeper, &words);
    keeper->begun_ns = clock_monotonic_ns();
    if (secret >= 0) {
        code = spawn(keeper, &words, secret);
        close(secret);
        keeper->runs = 1;
        if (code != 0)
            error_set(&err, STATUS_ERR_IO, "%s: cannot be run: %s", keeper->program, uv_strerror(code));
    }
    if (err.code == STATUS_OK)
        return;
    choose_wait(keeper);
    if (keeper->was_running)
        log_warn("no page for now: %s", err.text);
    else
        keeper->why = err;
    if (keeper->runs)
        uv_close((uv_handle_t *)&keeper->process, on_process_closed);
    else
        again(keeper);
}

status keeper_new(struct keeper **out, struct server *server, const struct page_options *options, struct error *err)
{
    struct keeper *keeper = mem_calloc(1, sizeof *keeper);

    *out = NULL;
    NEED(keeper, err, "the page's program");
    keeper->server = server;
    keeper->options = options;
    keeper->program = program_path();
    if (!keeper->program) {
        mem_free(keeper);
        return error_no_memory(err, "the page's program");
    }
    uv_timer_init(&server->loop, &keeper->timer);
    keeper->timer.data = keeper;
    start(keeper);
    *out = keeper;
    return STATUS_OK;
}

void keeper_listens(struct keeper *keeper, uint16_t port)
{
    if (!keeper->is_stopped)
        uv_timer_stop(&keeper->timer);
    keeper->was_running = 1;
    keeper->port = port;
}

int keeper_gave_up(const struct keeper *keeper, struct error *why)
{
    if (keeper->why.code != STATUS_OK)
        *why = keeper->why;
    else if (!keeper->was_running && clock_monotonic_ns() - keeper->begun_ns > KEEPER_START_MS * NS_PER_MS)
        error_set(why, STATUS_ERR_TIMEOUT, "the page's program azulejo-web does not answer");
    return why->code != STATUS_OK;
}

void keeper_hung(struct keeper *keeper)
{
    if (keeper->is_stopped || !keeper->runs || uv_is_closing((uv_handle_t *)&keeper->process))
        return;
    log_warn("the page's program azulejo-web does not answer: it is killed");
    (void)uv_process_kill(&keeper->process, SIGKILL);
}

static void on_end_time(uv_timer_t *timer)
{
    struct keeper *keeper = timer->data;

    if (keeper->runs && !uv_is_closing((uv_handle_t *)&keeper->process))
        (void)uv_process_kill(&keeper->process, SIGKILL);
}

void keeper_stop(struct keeper *keeper)
{
    if (keeper->is_stopped)
        return;
    keeper->is_stopped = 1;
    uv_timer_stop(&keeper->timer);
    if (!keeper->runs) {
        uv_close((uv_handle_t *)&keeper->timer, NULL);
        return;
    }
    if (!uv_is_closing((uv_handle_t *)&keeper->process)) {
        (void)uv_process_kill(&keeper->process, SIGTERM);
        uv_timer_start(&keeper->timer, on_end_time, KEEPER_END_MS, 0);
    }
}

void keeper_free(struct keeper *keeper)
{
    if (!keeper)
        return;
    mem_free(keeper->program);
    mem_free(keeper);
}
