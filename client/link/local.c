#include "client/link/local.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "client/link/child.h"
#include "client/link/scratch.h"
#include "client/link/signals.h"
#include "client/terminal/must.h"
#include "common/system/clock.h"
#include "common/base/memory.h"
#include "protocol/key.h"

enum {
    START_LIMIT_MS = 20000,  /* limit for the coordinator to print its address */
    STOP_LIMIT_MS = 3000,    /* between SIGTERM and SIGKILL */
    DYING_LIMIT_MS = 1000,   /* how long to look for the cause of a lost connection */
    LOG_PATH_SIZE = SCRATCH_PATH_SIZE + 64,
    LINE_SIZE = 512,
    ARGUMENTS_MAX = 16,
};
static const char listening[] = "listening on ";

struct local_farm {
    struct scratch scratch;
    char key_path[SCRATCH_PATH_SIZE + 16];
    int stops_seen; /* signals that local_farm_check tolerates */
    char address[LINE_SIZE];
    struct connection_options where;
    int verbose, web;
    int coordinator_stdout; /* kept open, so that it never writes into a closed pipe */
    unsigned worker_count;
    const char *double_worker;
    struct child coordinator;
    struct child workers[LOCAL_WORKERS_MAX];
    char labels[LOCAL_WORKERS_MAX][24];
    char reported[LOCAL_WORKERS_MAX];
};

/* ---- the temporary folder ----------------------------------------------------------------- */

static void log_path(const struct local_farm *farm, const char *label, char out[LOG_PATH_SIZE])
{
    snprintf(out, LOG_PATH_SIZE, "%s/%s.log", farm->scratch.path, label);
}

static status write_key(struct local_farm *farm, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    struct farm_key key;
    status result = farm_key_generate(&key, err);
    int fd;

    if (result != STATUS_OK)
        return result;
    snprintf(farm->key_path, sizeof farm->key_path, "%s/farm.key", farm->scratch.path);
    farm_key_print(&key, &text);
    fd = open(farm->key_path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600);
    if (fd < 0 || !buffer_ok(&text) || write(fd, text.data, text.size) != (ssize_t)text.size)
        result = error_set(err, STATUS_ERR_IO, "%s: cannot be written: %s", farm->key_path, strerror(errno));
    if (fd >= 0)
        close(fd);
    explicit_bzero(&key, sizeof key);
    buffer_wipe(&text);
    return result;
}

/* ---- the programs ------------------------------------------------------------------------- */

static status start_program(struct local_farm *farm, struct child *child, const char *label, const char *program,
                            const char *const *arguments, int stdout_fd, int death_signal, struct error *err)
{
    struct buffer path = BUFFER_INIT;
    char log[LOG_PATH_SIZE];
    char *argv[ARGUMENTS_MAX + 2];
    size_t count = 0;
    status result = STATUS_OK;

    if (strchr(program, '/'))
        buffer_puts(&path, program);
    else
        result = child_find_program(program, &path, err);
    must_hold(&path);
    if (result == STATUS_OK) {
        argv[count++] = (char *)path.data;
        while (*arguments && count <= ARGUMENTS_MAX)
            argv[count++] = (char *)*arguments++;
        argv[count] = NULL;
        log_path(farm, label, log);
        result = child_start(child, label, argv, farm->verbose ? NULL : log, stdout_fd, death_signal, err);
    }
    buffer_release(&path);
    return result;
}

static status program_ended(struct local_farm *farm, struct child *child, const char *when, struct error *err)
{
    char how[128], log[LOG_PATH_SIZE];

    child_describe_end(child, how, sizeof how);
    if (!farm->verbose) {
        log_path(farm, child->label, log);
        child_print_log_tail(log, child->label);
    }
    return error_set(err, STATUS_ERR_JOB_FAILED, "the local %s %s %s", child->label, how, when);
}

/* The rest of the line that starts with `prefix`; 1 if it is there, whole. */
static int take_line(const char *text, const char *prefix, char *out, size_t out_size)
{
    const char *line = strstr(text, prefix);
    const char *end = line ? strchr(line, '\n') : NULL;

    if (!end)
        return 0;
    line += strlen(prefix);
    snprintf(out, out_size, "%.*s", (int)(end - line), line);
    return 1;
}

/* The coordinator's first lines: 1 if all that we want of them are there. */
static int take_address(struct local_farm *farm, const char *text)
{
    char page[LINE_SIZE];

    if (!take_line(text, listening, farm->address, sizeof farm->address))
        return 0;
    farm->address[strcspn(farm->address, " ,\t\r")] = 0;
    if (!farm->web)
        return 1;
    if (!take_line(text, "page: ", page, sizeof page))
        return 0;
    fprintf(stderr, "page: %s\n", page);
    explicit_bzero(page, sizeof page);
    return 1;
}

static status await_address(struct local_farm *farm, struct error *err)
{
    uint64_t begin_ns = clock_monotonic_ns();
    char text[LINE_SIZE];
    size_t used = 0;

    while (used + 1 < sizeof text) {
        struct pollfd sources[2] = {{.fd = farm->coordinator_stdout, .events = POLLIN},
                                    {.fd = signals_fd(), .events = POLLIN}};
        int64_t spent_ms = (int64_t)((clock_monotonic_ns() - begin_ns) / NS_PER_MS);
        ssize_t got;

        if (spent_ms >= START_LIMIT_MS)
            break;
        poll(sources, 2, (int)(START_LIMIT_MS - spent_ms));
        signals_drain();
        if (signals_stop())
            return error_set(err, STATUS_ERR_JOB_FAILED, "interrupted");
        if (!(sources[0].revents & (POLLIN | POLLHUP)))
            continue;
        got = read(farm->coordinator_stdout, text + used, sizeof text - 1 - used);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0) {
            children_stop(&farm->coordinator, 1, DYING_LIMIT_MS);
            return program_ended(farm, &farm->coordinator, "before it was ready", err);
        }
        used += (size_t)got;
        text[used] = 0;
        if (take_address(farm, text))
            return STATUS_OK;
    }
    return error_set(err, STATUS_ERR_TIMEOUT, "the local coordinator did not print its address");
}

static status start_coordinator(struct local_farm *farm, struct error *err)
{
    const char *const arguments[] = {"--listen", "127.0.0.1:0", "--key", farm->key_path,
                                     "--store", farm->scratch.path, "--remove-store-at-end",
                                     "--precision", farm->double_worker ? "double" : "float",
                                     farm->web ? "--web" : "--no-web", farm->web ? "127.0.0.1:0" : NULL, NULL};
    int ends[2];
    status result;

    if (pipe2(ends, O_CLOEXEC) != 0)
        return error_set(err, STATUS_ERR_IO, "no pipe: %s", strerror(errno));
    farm->coordinator_stdout = ends[0];
    result =
        start_program(farm, &farm->coordinator, "coordinator", "azulejo-coordinator", arguments, ends[1], SIGTERM, err);
    close(ends[1]);
    THEN(result, await_address(farm, err));
    return result;
}

static status start_worker(struct local_farm *farm, unsigned index, unsigned threads, struct error *err)
{
    char cache[SCRATCH_PATH_SIZE + 32], count[16];
    const char *const arguments[] = {"--coordinator", farm->address, "--key", farm->key_path,
                                     "--threads", count, "--cache", cache, "--memory", "0",
                                     "--exit-on-disconnect", NULL};

    snprintf(farm->labels[index], sizeof farm->labels[index], "worker-%u", index + 1);
    snprintf(cache, sizeof cache, "%s/cache-%u", farm->scratch.path, index + 1);
    snprintf(count, sizeof count, "%u", threads);
    return start_program(farm, &farm->workers[index], farm->labels[index],
                         farm->double_worker ? farm->double_worker : "azulejo-worker", arguments, -1, SIGKILL, err);
}

/* Processors that this process may run on. */
static unsigned processors(void)
{
    cpu_set_t set;

    if (sched_getaffinity(0, sizeof set, &set) == 0)
        return (unsigned)CPU_COUNT(&set);
    return 1;
}

status local_farm_start(struct local_farm **out, const struct local_options *options, struct error *err)
{
    struct local_farm *farm = must(mem_calloc(1, sizeof *farm));
    unsigned threads = options->threads;
    status result;

    *out = NULL;
    farm->coordinator_stdout = -1;
    farm->scratch.owner_fd = -1;
    farm->verbose = options->verbose;
    farm->web = options->web;
    farm->double_worker = options->double_worker;
    if (threads == 0) {
        threads = processors() / options->workers;
        threads = threads ? threads : 1;
    }
    result = scratch_make(&farm->scratch, err);
    THEN(result, write_key(farm, err));
    THEN(result, start_coordinator(farm, err));
    for (unsigned i = 0; i < options->workers && result == STATUS_OK; i++) {
        result = start_worker(farm, i, threads, err);
        farm->worker_count = i + 1;
    }
    if (result != STATUS_OK) {
        local_farm_stop(farm);
        return result;
    }
    farm->where.coordinator = farm->address;
    farm->where.key_path = farm->key_path;
    farm->where.timeout_s = CONNECTION_TIMEOUT_DEFAULT_S;
    *out = farm;
    return STATUS_OK;
}

const struct connection_options *local_farm_address(const struct local_farm *farm) { return &farm->where; }

status local_farm_check(void *user, struct error *err)
{
    struct local_farm *farm = user;
    unsigned alive = 0;
    struct child *last = NULL;

    if (signals_stop_count() > farm->stops_seen)
        return error_set(err, STATUS_ERR_JOB_FAILED, "interrupted; the job was abandoned");
    if (child_has_ended(&farm->coordinator))
        return program_ended(farm, &farm->coordinator, "in the middle of the job", err);
    for (unsigned i = 0; i < farm->worker_count; i++) {
        struct child *worker = &farm->workers[i];
        char how[128];
        if (!child_has_ended(worker)) {
            alive++;
            continue;
        }
        last = worker;
        if (farm->reported[i] || farm->worker_count == 1)
            continue;
        farm->reported[i] = 1;
        child_describe_end(worker, how, sizeof how);
        fprintf(stderr, "%swarning: the local %s %s; the others take over its tiles\n",
                isatty(STDERR_FILENO) ? "\r\033[K" : "", worker->label, how);
    }
    if (alive == 0 && last)
        return program_ended(farm, last,
                             farm->worker_count > 1 ? "as the last of the workers" : "in the middle of the job", err);
    return STATUS_OK;
}

void local_farm_tolerate(struct local_farm *farm) { farm->stops_seen = signals_stop_count(); }

status local_farm_explain(struct local_farm *farm, status code, struct error *err)
{
    uint64_t begin_ns = clock_monotonic_ns();

    if (signals_stop() || (code != STATUS_ERR_UNREACHABLE && code != STATUS_ERR_PROTOCOL))
        return code;
    while (!child_has_ended(&farm->coordinator) && clock_monotonic_ns() - begin_ns < DYING_LIMIT_MS * NS_PER_MS) {
        struct pollfd source = {.fd = signals_fd(), .events = POLLIN};
        poll(&source, 1, 50);
        signals_drain();
    }
    if (child_has_ended(&farm->coordinator))
        return program_ended(farm, &farm->coordinator, "in the middle of the job", err);
    return code;
}

void local_farm_stop(struct local_farm *farm)
{
    struct child all[LOCAL_WORKERS_MAX + 1];

    if (!farm)
        return;
    all[0] = farm->coordinator;
    memcpy(all + 1, farm->workers, farm->worker_count * sizeof all[0]);
    children_stop(all, farm->worker_count + 1, STOP_LIMIT_MS);
    if (farm->coordinator_stdout >= 0)
        close(farm->coordinator_stdout);
    scratch_remove(&farm->scratch);
    mem_free(farm);
}
