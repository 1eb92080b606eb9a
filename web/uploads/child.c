#include "web/uploads/child.h"

#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"
#include "web/uploads/child_parts.h"

enum {
    HANDLES = 4,                /* process, timer, two pipes */
    READ_BYTES = 64 << 10,
    ERRORS_KEPT = 64 << 10,     /* of what it prints to its standard error */
    NUMBER_SIZE = 24,
};

struct web_child {
    uv_process_t process;
    uv_timer_t timer;
    uv_pipe_t pipes[2];    /* its standard output and error, */
    struct buffer text[2]; /* and what they gave */
    size_t output_bytes;
    web_child_end_fn *on_end; /* NULL: abandoned */
    void *user;
    enum web_child_end end;
    int64_t exit_status;
    int signal;
    int exited, ends, closed; /* ends: of the pipes */
    uint8_t piece[READ_BYTES];
};

/* ---- the end ------------------------------------------------------------------------------ */

static void on_closed(uv_handle_t *handle)
{
    struct web_child *c = handle->data;

    if (++c->closed < HANDLES)
        return;
    if (c->on_end) {
        const struct web_child_result result = {c->end, c->exit_status, c->signal, &c->text[0], &c->text[1]};
        c->on_end(c->user, &result);
    }
    buffer_release(&c->text[0]);
    buffer_release(&c->text[1]);
    mem_free(c);
}

static void close_all(struct web_child *c)
{
    uv_handle_t *handles[HANDLES] = {(uv_handle_t *)&c->process, (uv_handle_t *)&c->timer,
                                     (uv_handle_t *)&c->pipes[0], (uv_handle_t *)&c->pipes[1]};

    for (int i = 0; i < HANDLES; i++)
        if (!uv_is_closing(handles[i]))
            uv_close(handles[i], on_closed);
}

static void end_if_over(struct web_child *c)
{
    if (c->exited && c->ends == 2)
        close_all(c);
}

static void kill_group(struct web_child *c)
{
    if (!c->exited)
        (void)uv_kill(-c->process.pid, SIGKILL); /* the group's number is the leader's */
}

static void stop(struct web_child *c, enum web_child_end why)
{
    if (c->end == CHILD_EXITED && !c->exited)
        c->end = why;
    kill_group(c);
}

void web_child_kill(struct web_child *child) { stop(child, CHILD_KILLED); }

void web_child_abandon(struct web_child *child)
{
    kill_group(child);
    child->on_end = NULL;
    close_all(child);
}

static void on_exit_(uv_process_t *process, int64_t exit_status, int signal)
{
    struct web_child *c = process->data;

    c->exited = 1;
    c->exit_status = exit_status;
    c->signal = signal;
    uv_timer_stop(&c->timer);
    end_if_over(c);
}

static void on_limit(uv_timer_t *timer) { stop(timer->data, CHILD_TOO_LONG); }

/* ---- its output --------------------------------------------------------------------------- */

static void on_space(uv_handle_t *handle, size_t wanted UNUSED, uv_buf_t *out)
{
    struct web_child *c = handle->data;

    *out = uv_buf_init((char *)c->piece, sizeof c->piece);
}

static void take(struct web_child *c, int which, size_t size)
{
    struct buffer *text = &c->text[which];

    if (which == 0 && text->size + size > c->output_bytes) {
        stop(c, CHILD_TOO_MUCH);
        return;
    }
    buffer_append(text, c->piece, size);
    if (which == 1 && text->size > 2 * ERRORS_KEPT)
        buffer_consume(text, text->size - ERRORS_KEPT);
}

static void on_read(uv_stream_t *stream, ssize_t size, const uv_buf_t *space UNUSED)
{
    struct web_child *c = stream->data;

    if (size > 0) {
        take(c, stream == (uv_stream_t *)&c->pipes[1], (size_t)size);
    } else if (size < 0) {
        (void)uv_read_stop(stream);
        c->ends++;
        end_if_over(c);
    }
}

/* ---- the start ---------------------------------------------------------------------------- */

static size_t count(const char *const *words)
{
    size_t n = 0;

    while (words[n])
        n++;
    return n;
}

/* The words that web_child_launch reads: its own, then the program and its arguments. */
static const char **launch_words(const struct web_child_options *o, char numbers[CHILD_NUMBERS][NUMBER_SIZE])
{
    size_t n = count(o->arguments);
    const char **words = mem_calloc(CHILD_LAUNCH_WORDS + n + 1, sizeof *words);

    if (!words)
        return NULL;
    snprintf(numbers[0], NUMBER_SIZE, "%ld", (long)uv_os_getpid());
    snprintf(numbers[1], NUMBER_SIZE, "%" PRIu64, o->memory_bytes);
    snprintf(numbers[2], NUMBER_SIZE, "%" PRIu64, o->processor_s);
    snprintf(numbers[3], NUMBER_SIZE, "%" PRIu64, o->file_bytes);
    snprintf(numbers[4], NUMBER_SIZE, "%u", o->wall_port);
    snprintf(numbers[5], NUMBER_SIZE, "%d", o->resolves);
    words[0] = "azulejo-web";
    words[1] = CHILD_LAUNCH_COMMAND;
    for (int i = 0; i < CHILD_NUMBERS; i++)
        words[2 + i] = numbers[i];
    words[CHILD_LAUNCH_WORDS - 1] = o->program;
    memcpy(words + CHILD_LAUNCH_WORDS, o->arguments, n * sizeof *words);
    return words;
}

static int spawn(struct web_child *c, uv_loop_t *loop, const struct web_child_options *o, const char **words)
{
    uv_stdio_container_t stdio[CHILD_SECRET_FD + 1] = {{.flags = UV_IGNORE}};
    uv_process_options_t how = {0};

    for (int i = 0; i < 2; i++) {
        stdio[1 + i].flags = (uv_stdio_flags)(UV_CREATE_PIPE | UV_WRITABLE_PIPE);
        stdio[1 + i].data.stream = (uv_stream_t *)&c->pipes[i];
    }
    stdio[CHILD_SECRET_FD].flags = o->secret >= 0 ? UV_INHERIT_FD : UV_IGNORE;
    stdio[CHILD_SECRET_FD].data.fd = o->secret;
    how.file = "/proc/self/exe";
    how.args = (char **)(uintptr_t)words; /* libuv only reads them */
    how.env = (char **)(uintptr_t)o->environment;
    how.cwd = o->folder;
    how.flags = UV_PROCESS_DETACHED; /* a session of its own, and with it a group */
    how.stdio = stdio;
    how.stdio_count = CHILD_SECRET_FD + 1;
    how.exit_cb = on_exit_;
    return uv_spawn(loop, &c->process, &how);
}

static void init_handles(struct web_child *c, uv_loop_t *loop)
{
    uv_timer_init(loop, &c->timer);
    c->timer.data = c->process.data = c;
    for (int i = 0; i < 2; i++) {
        uv_pipe_init(loop, &c->pipes[i], 0);
        c->pipes[i].data = c;
    }
}

status web_child_start(struct web_child **out, uv_loop_t *loop, const struct web_child_options *options,
                       web_child_end_fn *on_end, void *user, struct error *err)
{
    struct web_child *c = mem_calloc(1, sizeof *c);
    char numbers[CHILD_NUMBERS][NUMBER_SIZE];
    const char **words = c ? launch_words(options, numbers) : NULL;
    int code;

    *out = NULL;
    if (!words) {
        mem_free(c);
        return error_no_memory(err, "a program to run");
    }
    c->output_bytes = options->output_bytes;
    init_handles(c, loop);
    code = spawn(c, loop, options, words);
    c->exited = code != 0;
    mem_free(words);
    if (code == 0)
        code = uv_read_start((uv_stream_t *)&c->pipes[0], on_space, on_read);
    if (code == 0)
        code = uv_read_start((uv_stream_t *)&c->pipes[1], on_space, on_read);
    if (code == 0)
        code = uv_timer_start(&c->timer, on_limit, options->limit_ms, 0);
    if (code != 0) {
        web_child_abandon(c);
        return error_set(err, STATUS_ERR_IO, "%s: cannot be run: %s", options->program, uv_strerror(code));
    }
    c->on_end = on_end;
    c->user = user;
    *out = c;
    return STATUS_OK;
}
