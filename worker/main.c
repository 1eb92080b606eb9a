/* azulejo-worker: connects out to a coordinator and renders tiles on all its cores. */
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#include <uv.h>

#include "common/base/buffer.h"
#include "common/cli/completion.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/system/machine.h"
#include "common/cli/options.h"
#include "common/base/tags.h"
#include "common/scene/settings.h"
#include "protocol/address.h"
#include "protocol/worker_name.h"
#include "worker/agent.h"
#include "worker/render/render.h"
#include "worker/key_file.h"
#include "worker/profile.h"
#include "worker/pool.h"

#define CACHE_LIMIT_DEFAULT (10ull << 30)

struct program {
    uv_loop_t loop;
    uv_signal_t interrupt, terminate, pause, resume;
    struct agent *agent;
    int signals;
};

static void on_signal(uv_signal_t *handle, int signal_number)
{
    struct program *p = handle->data;
    const char *name = signal_number == SIGINT ? "SIGINT" : "SIGTERM";

    if (p->signals++) {
        log_warn("%s again: ending at once; other workers will render its units", name);
        _exit(128 + signal_number);
    }
    agent_drain(p->agent, name);
}

static void on_pause_signal(uv_signal_t *handle, int signal_number)
{
    struct program *p = handle->data;

    agent_set_paused(p->agent, signal_number == SIGUSR1);
}

/* The handles must not keep the loop alive once the agent is done. */
static void watch_signals(struct program *p)
{
    uv_signal_init(&p->loop, &p->interrupt);
    uv_signal_init(&p->loop, &p->terminate);
    uv_signal_init(&p->loop, &p->pause);
    uv_signal_init(&p->loop, &p->resume);
    p->interrupt.data = p->terminate.data = p->pause.data = p->resume.data = p;
    uv_signal_start(&p->interrupt, on_signal, SIGINT);
    uv_signal_start(&p->terminate, on_signal, SIGTERM);
    uv_signal_start(&p->pause, on_pause_signal, SIGUSR1);
    uv_signal_start(&p->resume, on_pause_signal, SIGUSR2);
    uv_unref((uv_handle_t *)&p->pause);
    uv_unref((uv_handle_t *)&p->resume);
    uv_unref((uv_handle_t *)&p->interrupt);
    uv_unref((uv_handle_t *)&p->terminate);
}

static status isa_list_parse(const char *text, uint32_t *mask, struct error *err)
{
    uint32_t has = isa_supported_mask();

    *mask = 0;
    while (*text) {
        size_t length = strcspn(text, ",");
        char name[16];
        int isa;
        snprintf(name, sizeof name, "%.*s", (int)(length < sizeof name ? length : sizeof name - 1), text);
        isa = isa_parse(name);
        if (isa < 0 || length >= sizeof name)
            return error_set(err, STATUS_ERR_USAGE, "--isa: '%.*s' is not one of sse2, avx2, avx512", (int)length,
                             text);
        if (!(has >> isa & 1))
            return error_set(err, STATUS_ERR_USAGE, "--isa: this processor has no %s", name);
        *mask |= 1u << isa;
        text += length;
        text += *text == ',';
    }
    if (*mask == 0)
        return error_set(err, STATUS_ERR_USAGE, "--isa: name at least one of sse2, avx2, avx512");
    return STATUS_OK;
}

/* `text` as given, else $variable, else $xdg/azulejo`tail`, else $HOME/`home`/azulejo`tail`. */
static status default_path(struct buffer *out, const char *given, const char *variable, const char *xdg,
                           const char *home, const char *tail, const char *option, struct error *err)
{
    const char *named = variable ? getenv(variable) : NULL;
    const char *base = getenv(xdg), *user = getenv("HOME");

    if (given)
        buffer_puts(out, given);
    else if (named && *named)
        buffer_puts(out, named);
    else if (base && *base == '/')
        buffer_printf(out, "%s/azulejo%s", base, tail);
    else if (user && *user == '/')
        buffer_printf(out, "%s/%s/azulejo%s", user, home, tail);
    else
        return error_set(err, STATUS_ERR_USAGE, "HOME is not set: give --%s", option);
    return buffer_ok(out) ? STATUS_OK : error_no_memory(err, "a path");
}

static status duty_from(struct duty_options *out, const char *hours, int when_idle, double idle_load, double idle_for_s,
                        struct error *err)
{
    struct usage usage;

    if (when_idle && !usage_init(&usage))
        return error_set(err, STATUS_ERR_USAGE,
                         "--when-idle: /proc/stat, which has the machine's load, cannot be read");
    out->when_idle = when_idle;
    out->idle_load = idle_load / 100;
    out->idle_for_s = idle_for_s;
    return hours ? hours_parse(&out->hours, hours, err) : STATUS_OK;
}

/* Before any thread is started: they inherit it. */
static status be_nice(int value, struct error *err)
{
    if (getpriority(PRIO_PROCESS, 0) >= value || setpriority(PRIO_PROCESS, 0, value) == 0)
        return STATUS_OK;
    return error_set(err, STATUS_ERR_IO, "--nice %d: not allowed here: %s", value, strerror(errno));
}

/* The first thread's stack grows as it is used, and where memory is short then, the process ends. A message takes 300 KiB. */
static __attribute__((noinline)) void hold_stack(void)
{
    enum { PAGE = 4096 };
    volatile char stack[512 << 10];

    for (size_t i = 0; i < sizeof stack; i += PAGE)
        stack[i] = 0;
}

/* *stopped: a signal ended it. */
static status run(const struct agent_options *options, int *stopped, struct error *err)
{
    struct error no_profile = {0};
    struct program p;
    status s;

    memset(&p, 0, sizeof p);
    if (uv_loop_init(&p.loop) != 0)
        return error_set(err, STATUS_ERR_INTERNAL, "the event loop cannot be created");
    if (profile_start(PROFILE_PERIOD_NS, &no_profile) != STATUS_OK)
        log_warn("%s; frames will not say where their time went", no_profile.text);
    s = agent_new(&p.agent, &p.loop, options, err);
    if (s == STATUS_OK) {
        watch_signals(&p);
        uv_run(&p.loop, UV_RUN_DEFAULT);
        s = agent_result(p.agent, err);
        agent_free(p.agent);
        uv_close((uv_handle_t *)&p.interrupt, NULL);
        uv_close((uv_handle_t *)&p.terminate, NULL);
        uv_close((uv_handle_t *)&p.pause, NULL);
        uv_close((uv_handle_t *)&p.resume, NULL);
        uv_run(&p.loop, UV_RUN_DEFAULT);
    }
    profile_stop();
    *stopped = p.signals > 0;
    uv_loop_close(&p.loop);
    return s;
}

int main(int argc, char **argv)
{
    const char *coordinator = getenv("AZULEJO_COORDINATOR"), *key_path = NULL, *cache = NULL;
    const char *isa_list = NULL, *log_level = "info", *log_format = NULL, *completion = NULL, *tag_list = NULL;
    char tags[TAGS_TEXT_MAX + 1] = "";
    uint64_t memory = UINT64_MAX;
    int64_t threads = 0;
    uint64_t cache_limit = CACHE_LIMIT_DEFAULT;
    int exit_on_disconnect = 0, version = 0, help = 0, stopped = 0;
    const char *name = NULL, *hours = NULL;
    double idle_load = DUTY_IDLE_LOAD_PERCENT, idle_for_s = DUTY_IDLE_FOR_S;
    int64_t nice_value = 0, drain_status = 0;
    int when_idle = 0;
    const struct option table[] = {
        {"coordinator", 'c', OPTION_STRING, &coordinator, "HOST[:PORT]",
         "where the coordinator listens (default $AZULEJO_COORDINATOR, else 127.0.0.1:7420)", 0, 0,
         NULL},
        {"key", 'k', OPTION_STRING, &key_path, "FILE",
         "farm or worker key (default $AZULEJO_KEY, else ~/.config/azulejo/farm.key)", 0, 0, NULL},
        {"threads", 't', OPTION_INT, &threads, "N", "tiles rendered at once (default: all cores)",
         1, POOL_THREADS_MAX, NULL},
        {"cache", 0, OPTION_STRING, &cache, "DIR",
         "where scenes are kept (default $XDG_CACHE_HOME/azulejo, else ~/.cache/azulejo)", 0, 0,
         NULL},
        {"cache-limit", 0, OPTION_SIZE, &cache_limit, "SIZE",
         "remove the least recently used above this size (default 10G)", 0, 0, NULL},
        {"isa", 0, OPTION_STRING, &isa_list, "LIST",
         "instruction sets to offer, of sse2,avx2,avx512 (default: what the processor has)", 0, 0,
         NULL},
        {"name", 'n', OPTION_STRING, &name, "NAME",
         "its name on the farm, after that of its key (default: the host's, with a number if several run there)", 0, 0, NULL},
        {"hours", 0, OPTION_STRING, &hours, "RANGES",
         "take work only at these local times, as in 20:00-08:00 or 12:00-13:00,20:00-08:00", 0, 0, NULL},
        {"when-idle", 0, OPTION_FLAG, &when_idle, NULL,
         "take work only while the machine is not used otherwise", 0, 0, NULL},
        {"idle-load", 0, OPTION_REAL, &idle_load, "PERCENT",
         "for --when-idle: other processes may take this share of its processors (default 25)", 0, 100, NULL},
        {"idle-for", 0, OPTION_REAL, &idle_for_s, "SECONDS",
         "for --when-idle: for how long it must not have been used (default 60)", 0, 86400, NULL},
        {"nice", 0, OPTION_INT, &nice_value, "N", "run with this nice value, 0 to 19 (default: as started)",
         0, 19, NULL},
        {"drain-status", 0, OPTION_INT, &drain_status, "N",
         "exit with this status, 0 to 125, after SIGTERM or SIGINT (default 0)", 0, 125, NULL},
        {"tag", 0, OPTION_STRING, &tag_list, "NAME[,NAME]...",
         "marks for jobs that require them, as in gpu,big (default: none)", 0, 0, NULL},
        {"memory", 0, OPTION_SIZE, &memory, "SIZE",
         "announce this much memory; scenes that need more go elsewhere; 0: announce none "
         "(default: what the machine has, or its control group allows)", 0, 0, NULL},
        {"exit-on-disconnect", 0, OPTION_FLAG, &exit_on_disconnect, NULL,
         "end when the coordinator goes away instead of connecting again", 0, 0, NULL},
        {"log-level", 0, OPTION_CHOICE, &log_level, "LEVEL", "what to log (default info)", 0, 0,
         "error|warn|info|debug"},
        {"log-format", 0, OPTION_CHOICE, &log_format, "FORM",
         "lines of text, or JSON, an object a line (default $AZULEJO_LOG_FORMAT, else text)", 0, 0, "text|json"},
        {"completion", 0, OPTION_CHOICE, &completion, "SHELL",
         "print a script that completes command lines in a shell", 0, 0, COMPLETION_SHELLS},
        {"version", 0, OPTION_FLAG, &version, NULL, "print the version", 0, 0, NULL},
        {NULL, 0, OPTION_FLAG, NULL, NULL, NULL, 0, 0, NULL},
    };
    struct agent_options options = {0};
    struct buffer key_file = BUFFER_INIT, folder = BUFFER_INIT;
    struct positionals rest;
    struct key_file key;
    struct error err = {0};
    char host[256];
    status s;

    hold_stack();
    file_hold_standard();
    file_forgo_syncs(); /* it writes its cache alone, which it checks by digests */
    memset(&key, 0, sizeof key);
    log_setup("azulejo-worker", LOG_LEVEL_INFO);
    s = options_parse(table, argc, argv, &rest, &help, &err);
    THEN(s, log_set_format(log_format, &err));
    if (s == STATUS_OK && help) {
        options_print_help("azulejo-worker [OPTIONS]",
                           "Renders tiles for an Azulejo coordinator until it is stopped. "
                           "On SIGTERM or SIGINT\nit finishes units in progress and returns the rest; "
                           "a second signal ends it at once. SIGUSR1 pauses it, SIGUSR2 ends that pause.",
                           table);
        return 0;
    }
    if (s == STATUS_OK && version) {
        printf("azulejo-worker %s %s\n", AZULEJO_VERSION, render_precision());
        return 0;
    }
    if (s == STATUS_OK && completion) {
        s = completion_print("azulejo-worker", completion, "azulejo-worker [OPTIONS]", table, &err);
        return s == STATUS_OK && fflush(stdout) == 0 ? 0 : status_exit_code(STATUS_ERR_IO);
    }
    if (s == STATUS_OK && rest.count > 0)
        s = error_set(&err, STATUS_ERR_USAGE, "unexpected argument '%s' (--help lists the options)", rest.items[0]);
    if (s == STATUS_OK)
        log_setup("azulejo-worker", (enum log_level)log_level_parse(log_level));
    THEN(s, address_parse(coordinator && *coordinator ? coordinator : "127.0.0.1", "127.0.0.1", 1, host, sizeof host,
                          &options.port, &err));
    THEN(s, duty_from(&options.duty, hours, when_idle, idle_load, idle_for_s, &err));
    if (s == STATUS_OK && name && !worker_name_is_valid(name))
        s = error_set(&err, STATUS_ERR_USAGE, "--name '%s': must have 1 to %d letters, digits, '.', '_' and '-'", name,
                      WORKER_NAME_BYTES_MAX);
    if (s == STATUS_OK && nice_value > 0)
        s = be_nice((int)nice_value, &err);
    options.isa_mask = isa_supported_mask();
    if (s == STATUS_OK && isa_list)
        s = isa_list_parse(isa_list, &options.isa_mask, &err);
    if (s == STATUS_OK && tag_list && tags_parse(tag_list, tags, &err) != STATUS_OK) {
        error_prefix(&err, "--tag");
        s = err.code;
    }
    options.tags = tags;
    options.memory = memory == UINT64_MAX ? machine_memory_total() : memory;
    THEN(s, default_path(&key_file, key_path, "AZULEJO_KEY", "XDG_CONFIG_HOME", ".config", "/farm.key", "key", &err));
    THEN(s, key_file_load(&key, buffer_text(&key_file), &err));
    THEN(s, default_path(&folder, cache, NULL, "XDG_CACHE_HOME", ".cache", "", "cache", &err));
    if (s == STATUS_OK) {
        options.host = host;
        options.key_file = &key;
        options.threads = threads ? (unsigned)threads : uv_available_parallelism();
        options.cache_folder = buffer_text(&folder);
        options.cache_limit_bytes = cache_limit;
        options.exit_on_disconnect = exit_on_disconnect;
        options.name = name;
        options.drain_status = (int)drain_status;
        s = run(&options, &stopped, &err);
    }
    if (s != STATUS_OK)
        log_error("%s", err.text);
    buffer_release(&key_file);
    buffer_release(&folder);
    return s == STATUS_OK && stopped ? (int)drain_status : status_exit_code(s);
}
