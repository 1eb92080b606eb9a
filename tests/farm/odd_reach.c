/* odd_reach: preloaded into a program, says what each of its threads may do with files.
 *
 * At SIGUSR2 the thread that gets it tries every item of ODD_REACH, which are parted by colons: r/PATH is opened to read,
 * w/PATH to write, x/PATH executed in a child; at "spin" it computes for good, at "hang" it sleeps for good. It
 * writes a line for each to standard error:
 *
 *   reach THREAD ITEM ERRNO
 */
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

static int try_open(const char *path, int flags)
{
    int fd = open(path, flags | O_CLOEXEC);

    if (fd < 0)
        return errno;
    close(fd);
    return 0;
}

enum { NOT_EXECUTED = 100 }; /* a status above: with this errno */

static int try_execute(const char *path)
{
    char *const words[] = {(char *)path, NULL};
    int status = 0;
    pid_t child = fork();

    if (child == 0) {
        execv(path, words);
        _exit(NOT_EXECUTED + errno);
    }
    waitpid(child, &status, 0);
    return WEXITSTATUS(status) > NOT_EXECUTED ? WEXITSTATUS(status) - NOT_EXECUTED : 0;
}

static void on_signal(int number)
{
    const char *at = getenv("ODD_REACH");

    (void)number;
    while (at && *at) {
        char item[1024], line[1100];
        size_t length = strcspn(at, ":");
        int code, size;

        snprintf(item, sizeof item, "%.*s", (int)length, at);
        while (strcmp(item, "spin") == 0)
            continue;
        while (strcmp(item, "hang") == 0)
            sleep(1);
        code = item[0] == 'x' ? try_execute(item + 1) : try_open(item + 1, item[0] == 'w' ? O_WRONLY : O_RDONLY);
        size = snprintf(line, sizeof line, "reach %ld %s %d\n", syscall(SYS_gettid), item, code);
        if (write(STDERR_FILENO, line, (size_t)size) != size)
            return;
        at += length + (at[length] == ':');
    }
}

__attribute__((constructor)) static void begin(void)
{
    sigaction(SIGUSR2, &(struct sigaction){.sa_handler = on_signal, .sa_flags = SA_RESTART}, NULL);
}
