#include "client/link/child.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client/link/signals.h"
#include "common/system/clock.h"
#include "protocol/message.h"

enum { TAIL_BYTES = 4096, TAIL_LINES = 15, STOP_POLL_MS = 5 };

static int is_program(const char *path)
{
    struct stat info;

    return stat(path, &info) == 0 && S_ISREG(info.st_mode) && access(path, X_OK) == 0;
}

static int try_folder(const char *folder, size_t length, const char *name, struct buffer *path)
{
    struct buffer candidate = BUFFER_INIT;
    int found;

    buffer_printf(&candidate, "%.*s/%s", (int)length, folder, name);
    found = buffer_ok(&candidate) && is_program(buffer_text(&candidate));
    if (found)
        buffer_puts(path, buffer_text(&candidate));
    buffer_release(&candidate);
    return found;
}

status child_find_program(const char *name, struct buffer *path, struct error *err)
{
    char self[4096];
    ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
    const char *at = getenv("PATH");

    if (length > 0) {
        char *slash;
        self[length] = 0;
        slash = strrchr(self, '/');
        if (slash && try_folder(self, (size_t)(slash - self), name, path))
            return STATUS_OK;
    }
    while (at && *at) {
        size_t part = strcspn(at, ":");
        if (part && try_folder(at, part, name, path))
            return STATUS_OK;
        at += part + (at[part] == ':');
    }
    return error_set(err, STATUS_ERR_INPUT,
                     "the program %s is neither beside azulejo nor in PATH: build it with 'make', or "
                     "install all three programs",
                     name);
}

/* In the child, between fork and exec: only async-signal-safe calls. */
static void run_child(char *const argv[], int log_fd, int stdin_fd, int stdout_fd, int death_signal, pid_t parent)
{
    static const char sorry[] = ": cannot be started\n";
    sigset_t none;
    int in = stdin_fd >= 0 ? stdin_fd : open("/dev/null", O_RDONLY);

    prctl(PR_SET_PDEATHSIG, death_signal);
    if (getppid() != parent)
        _exit(127); /* the parent died before the line above */
    setpgid(0, 0);
    signals_restore_in_child();
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
    if (in >= 0)
        dup2(in, STDIN_FILENO);
    if (log_fd >= 0)
        dup2(log_fd, STDERR_FILENO);
    dup2(stdout_fd >= 0 ? stdout_fd : STDERR_FILENO, STDOUT_FILENO);
    execv(argv[0], argv);
    if (write(STDERR_FILENO, argv[0], strlen(argv[0])) < 0 || write(STDERR_FILENO, sorry, sizeof sorry - 1) < 0)
        _exit(126);
    _exit(127);
}

status child_start(struct child *child, const char *label, char *const argv[], const char *log_path, int stdout_fd,
                   int death_signal, struct error *err)
{
    return child_start_fed(child, label, argv, log_path, -1, stdout_fd, death_signal, err);
}

status child_start_fed(struct child *child, const char *label, char *const argv[], const char *log_path, int stdin_fd,
                       int stdout_fd, int death_signal, struct error *err)
{
    pid_t parent = getpid();
    int log_fd = -1;

    memset(child, 0, sizeof *child);
    child->label = label;
    if (log_path) {
        log_fd = open(log_path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0600);
        if (log_fd < 0)
            return error_set(err, STATUS_ERR_IO, "%s: %s", log_path, strerror(errno));
    }
    child->pid = fork();
    if (child->pid == 0)
        run_child(argv, log_fd, stdin_fd, stdout_fd, death_signal, parent);
    if (log_fd >= 0)
        close(log_fd);
    if (child->pid < 0) {
        child->pid = 0;
        return error_set(err, STATUS_ERR_IO, "%s cannot be started: %s", label, strerror(errno));
    }
    return STATUS_OK;
}

int child_has_ended(struct child *child)
{
    int wait_status;

    if (child->pid == 0 || child->ended)
        return 1;
    if (waitpid(child->pid, &wait_status, WNOHANG) != child->pid)
        return 0;
    child->ended = 1;
    child->wait_status = wait_status;
    return 1;
}

void child_describe_end(const struct child *child, char *out, size_t size)
{
    if (WIFSIGNALED(child->wait_status))
        snprintf(out, size, "was killed by signal %d (%s)", WTERMSIG(child->wait_status),
                 strsignal(WTERMSIG(child->wait_status)));
    else
        snprintf(out, size, "ended with exit status %d", WEXITSTATUS(child->wait_status));
}

void children_stop(struct child *children, size_t count, unsigned limit_ms)
{
    uint64_t begin_ns = clock_monotonic_ns();
    size_t left;

    for (size_t i = 0; i < count; i++)
        if (!child_has_ended(&children[i]))
            kill(children[i].pid, SIGTERM);
    do {
        struct pollfd nothing = {.fd = signals_fd(), .events = POLLIN};
        left = 0;
        for (size_t i = 0; i < count; i++)
            left += !child_has_ended(&children[i]);
        if (left) {
            /* SIGCHLD's byte wakes us when a child ends; the short limit covers a byte that was drained earlier. */
            poll(&nothing, 1, STOP_POLL_MS);
            signals_drain();
        }
    } while (left && clock_monotonic_ns() - begin_ns < limit_ms * NS_PER_MS);
    for (size_t i = 0; i < count; i++) {
        if (child_has_ended(&children[i]))
            continue;
        kill(children[i].pid, SIGKILL);
        while (waitpid(children[i].pid, &children[i].wait_status, 0) < 0 && errno == EINTR) {
        }
        children[i].ended = 1;
    }
}

void child_print_log_tail(const char *log_path, const char *label)
{
    char text[TAIL_BYTES + 1];
    FILE *file = fopen(log_path, "rbe");
    size_t got, begin, lines = 0;

    if (!file)
        return;
    if (fseek(file, -TAIL_BYTES, SEEK_END) != 0)
        rewind(file);
    got = fread(text, 1, TAIL_BYTES, file);
    fclose(file);
    while (got && text[got - 1] == '\n')
        got--;
    text[got] = 0;
    for (begin = got; begin > 0; begin--)
        if (text[begin - 1] == '\n' && ++lines == TAIL_LINES)
            break;
    if (got == begin) {
        fprintf(stderr, "(%s wrote nothing)\n", label);
        return;
    }
    fprintf(stderr, "the end of %s's log:\n", label);
    for (char *line = strtok(text + begin, "\n"); line; line = strtok(NULL, "\n")) {
        char printable[TAIL_BYTES + 1];
        fprintf(stderr, "  | %s\n", message_text(printable, sizeof printable, line));
    }
}
