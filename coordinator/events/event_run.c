#include "coordinator/events/event_run.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "common/system/clock.h"

enum {
    LOOK_MS = 100,               /* has it ended, and is it to end? */
    LINE_SIZE = 256,
    VARIABLE_SIZE = 4096,
};

struct run {
    pid_t process;        /* and its group */
    int errors;           /* its standard error; -1: closed */
    char line[LINE_SIZE]; /* the last one that is not empty */
    char next[LINE_SIZE]; /* the one that it is writing */
    size_t next_size;
    int64_t pause_ms; /* the next wait without its standard error */
};

status event_program_check(const char *path, struct error *err)
{
    struct stat info;

    if (stat(path, &info) != 0)
        return error_set(err, STATUS_ERR_INPUT, "--on-event: %s: %s; name a program that is there", path, strerror(errno));
    if (!S_ISREG(info.st_mode))
        return error_set(err, STATUS_ERR_INPUT, "--on-event: %s is no file; name a program", path);
    if (access(path, X_OK) != 0)
        return error_set(err, STATUS_ERR_INPUT, "--on-event: %s cannot be executed: %s; 'chmod +x' makes a file a program",
                         path, strerror(errno));
    return STATUS_OK;
}

/* ---- its start ---------------------------------------------------------------------------------- */

/* The variables that it gets, in `texts`. */
static void make_environment(char texts[4][VARIABLE_SIZE], char *out[5])
{
    static const char *const names[4] = {"PATH", "HOME", "LANG", "TZ"};
    size_t count = 0;

    for (size_t i = 0; i < 4; i++) {
        const char *value = getenv(names[i]);
        if (!value && i == 0)
            value = "/usr/local/bin:/usr/bin:/bin";
        if (value && snprintf(texts[count], VARIABLE_SIZE, "%s=%s", names[i], value) < VARIABLE_SIZE) {
            out[count] = texts[count];
            count++;
        }
    }
    out[count] = NULL;
}

/* No signal is ignored or blocked, as this process and its threads do; a process group of its own. */
static int set_attributes(posix_spawnattr_t *attributes)
{
    sigset_t all, none;
    int code = posix_spawnattr_setflags(attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETSIGMASK);

    sigemptyset(&none);
    sigfillset(&all);
    sigdelset(&all, SIGKILL);
    sigdelset(&all, SIGSTOP);
    if (code == 0)
        code = posix_spawnattr_setsigdefault(attributes, &all);
    return code ? code : posix_spawnattr_setsigmask(attributes, &none);
}

static int set_files(posix_spawn_file_actions_t *files, int input, int errors)
{
    int code = posix_spawn_file_actions_adddup2(files, input, STDIN_FILENO);

    if (code == 0)
        code = posix_spawn_file_actions_addopen(files, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    if (code == 0)
        code = posix_spawn_file_actions_adddup2(files, errors, STDERR_FILENO);
    return code ? code : posix_spawn_file_actions_addclosefrom_np(files, STDERR_FILENO + 1);
}

/* 0, or an errno. */
static int spawn(pid_t *process, const char *program, int input, int errors)
{
    char texts[4][VARIABLE_SIZE], *environment[5], *words[] = {(char *)program, NULL};
    posix_spawn_file_actions_t files;
    posix_spawnattr_t attributes;
    int code = posix_spawn_file_actions_init(&files);

    if (code != 0)
        return code;
    code = posix_spawnattr_init(&attributes);
    if (code == 0) {
        code = set_attributes(&attributes);
        if (code == 0)
            code = set_files(&files, input, errors);
        make_environment(texts, environment);
        if (code == 0)
            code = posix_spawn(process, program, &files, &attributes, words, environment);
        posix_spawnattr_destroy(&attributes);
    }
    posix_spawn_file_actions_destroy(&files);
    return code;
}

/* A file with the text, to be read from its beginning. -1: errno. */
static int make_input(const char *json)
{
    int fd = memfd_create("azulejo-event", MFD_CLOEXEC);
    size_t size = strlen(json);

    if (fd >= 0 && (write(fd, json, size) != (ssize_t)size || lseek(fd, 0, SEEK_SET) != 0)) {
        close(fd);
        fd = -1;
    }
    return fd;
}

/* 0, or an errno. */
static int begin(struct run *run, const char *program, const char *json)
{
    int input = make_input(json), errors[2] = {-1, -1}, code = 0;

    *run = (struct run){.errors = -1, .pause_ms = 1};
    if (input < 0 || pipe2(errors, O_CLOEXEC) != 0 || fcntl(errors[0], F_SETFL, O_NONBLOCK) != 0)
        code = errno;
    if (code == 0)
        code = spawn(&run->process, program, input, errors[1]);
    if (input >= 0)
        close(input);
    if (errors[1] >= 0)
        close(errors[1]);
    if (code == 0)
        run->errors = errors[0];
    else if (errors[0] >= 0)
        close(errors[0]);
    return code;
}

/* ---- what it says ------------------------------------------------------------------------------- */

static void end_line(struct run *run)
{
    if (run->next_size > 0) {
        memcpy(run->line, run->next, run->next_size);
        run->line[run->next_size] = 0;
    }
    run->next_size = 0;
}

static void take_bytes(struct run *run, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        unsigned char c = (unsigned char)bytes[i];
        if (c == '\n')
            end_line(run);
        else if (run->next_size < LINE_SIZE - 1)
            run->next[run->next_size++] = c < ' ' || c == 0x7f ? ' ' : (char)c;
    }
}

/* Take what is there. */
static void read_errors(struct run *run)
{
    char bytes[4096];
    ssize_t got;

    while (run->errors >= 0 && (got = read(run->errors, bytes, sizeof bytes)) != 0) {
        if (got > 0)
            take_bytes(run, bytes, (size_t)got);
        else if (errno != EINTR)
            return;
    }
    if (run->errors >= 0)
        close(run->errors);
    run->errors = -1;
}

/* ---- its end ------------------------------------------------------------------------------------ */

/* Until it says something or ends, and a moment at most. */
static void wait_a_moment(struct run *run)
{
    struct pollfd look = {.fd = run->errors, .events = POLLIN};

    if (run->errors < 0) { /* it is about to end, or has closed it */
        const struct timespec pause = {0, run->pause_ms * NS_PER_MS};
        nanosleep(&pause, NULL);
        run->pause_ms = 2 * run->pause_ms < LOOK_MS ? 2 * run->pause_ms : LOOK_MS;
    } else if (poll(&look, 1, LOOK_MS) > 0) {
        read_errors(run);
    }
}

/* It is left as a zombie, so that the number of its group stays its own. */
static int has_ended(const struct run *run)
{
    siginfo_t info = {0};

    return waitid(P_PID, (id_t)run->process, &info, WEXITED | WNOHANG | WNOWAIT) == 0 && info.si_pid == run->process;
}

/* Its status, as waitpid has it; *was_asked: it got SIGTERM. */
static int await(struct run *run, const atomic_int *ending, int *was_asked)
{
    const uint64_t until_ns = clock_monotonic_ns() + EVENT_RUN_S * NS_PER_SECOND;
    uint64_t kill_ns = 0;
    int result = 0;

    while (!has_ended(run)) {
        uint64_t now_ns = clock_monotonic_ns();
        if (!kill_ns && (now_ns >= until_ns || atomic_load(ending))) {
            (void)kill(-run->process, SIGTERM);
            kill_ns = now_ns + EVENT_END_MS * NS_PER_MS;
        } else if (kill_ns && now_ns >= kill_ns) {
            (void)kill(-run->process, SIGKILL);
        }
        wait_a_moment(run);
    }
    *was_asked = kill_ns > 0;
    if (*was_asked)
        (void)kill(-run->process, SIGKILL); /* what it has started */
    read_errors(run);
    end_line(run);
    while (waitpid(run->process, &result, 0) < 0 && errno == EINTR)
        ;
    return result;
}

enum event_fate event_run(const char *program, const char *json, const atomic_int *ending, char how[EVENT_HOW_SIZE])
{
    struct run run;
    int code = begin(&run, program, json), was_asked, result, length;

    if (code != 0) {
        snprintf(how, EVENT_HOW_SIZE, "cannot be run: %s", strerror(code));
        return EVENT_FATE_AGAIN;
    }
    result = await(&run, ending, &was_asked);
    if (run.errors >= 0)
        close(run.errors);
    if (WIFEXITED(result))
        length = snprintf(how, EVENT_HOW_SIZE, "exit status %d", WEXITSTATUS(result));
    else
        length = snprintf(how, EVENT_HOW_SIZE, "ended by signal %d", WTERMSIG(result));
    if (was_asked && !atomic_load(ending))
        length += snprintf(how + length, EVENT_HOW_SIZE - (size_t)length, ", after its %d s", EVENT_RUN_S);
    if (run.line[0])
        snprintf(how + length, EVENT_HOW_SIZE - (size_t)length, ": %s", run.line);
    if (WIFEXITED(result) && WEXITSTATUS(result) == 0)
        return EVENT_FATE_TAKEN;
    return WIFEXITED(result) && WEXITSTATUS(result) != EVENT_LATER ? EVENT_FATE_REFUSED : EVENT_FATE_AGAIN;
}
