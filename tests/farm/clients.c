/* clients: the command line client, linked and with its libraries ready, as a process that forks for each command. A farm
 * test runs the client some hundred times, mostly to look at a job: dynamic linking and the start of OpenSSL took
 * two thirds of each.
 *
 *   clients N       descriptor N is a socket of packets. Each is one command: the working folder, then the arguments,
 *                   each ended by a zero byte, with three descriptors: standard output, standard error and one to
 *                   which the process's number is written when it has begun and its wait status when it has ended.
 *
 * It has client/main.c's main (the linker's --wrap), and ends when the socket does.
 */
#include <errno.h>
#include <openssl/ssl.h>
#include <poll.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

enum { RUNNING_MAX = 256, WORDS_MAX = 1024, COMMAND_MAX_BYTES = 128 * 1024, OUT = 0, ERR = 1, REPORT = 2, LENT = 3 };

int __real_main(int argc, char **argv);
int __wrap_main(int argc, char **argv);

static struct {
    pid_t pid; /* 0: free */
    int report;
} running[RUNNING_MAX];

static _Noreturn void die(const char *why)
{
    fprintf(stderr, "clients: %s: %s\n", why, strerror(errno));
    exit(1);
}

/* All that a client's first connection would load. A fork need not clean it up. */
static void warm_up(void)
{
    OPENSSL_init_crypto(OPENSSL_INIT_NO_ATEXIT, NULL);

    SSL_CTX *ctx = SSL_CTX_new(TLS_client_method());
    SSL *ssl = ctx ? SSL_new(ctx) : NULL;

    if (!ssl)
        die("no OpenSSL");
    SSL_free(ssl);
    SSL_CTX_free(ctx);
}

static _Noreturn void run_client(char *command, size_t size_bytes, const int lent[LENT])
{
    static char *words[WORDS_MAX];
    sigset_t none;
    int count = 0;

    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
    if (dup2(lent[OUT], STDOUT_FILENO) < 0 || dup2(lent[ERR], STDERR_FILENO) < 0 || close_range(3, ~0U, 0) != 0)
        die("descriptors");
    if (chdir(command) != 0)
        die(command);
    for (char *word = command + strlen(command) + 1; word < command + size_bytes && count + 1 < WORDS_MAX; word += strlen(word) + 1)
        words[count++] = word;
    exit(__real_main(count, words));
}

static void report(int fd, int32_t number)
{
    if (write(fd, &number, sizeof number) != (ssize_t)sizeof number)
        fprintf(stderr, "clients: no report: %s\n", strerror(errno));
}

/* 0: the socket has ended. */
static int take_command(int socket)
{
    static char command[COMMAND_MAX_BYTES + 1];
    union {
        char bytes[CMSG_SPACE(LENT * sizeof(int))];
        struct cmsghdr align;
    } control;
    struct iovec data = {.iov_base = command, .iov_len = COMMAND_MAX_BYTES};
    struct msghdr message = {.msg_iov = &data, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
    ssize_t size_bytes = recvmsg(socket, &message, MSG_CMSG_CLOEXEC);
    struct cmsghdr *head;
    int lent[LENT], slot = 0;

    if (size_bytes <= 0)
        return 0;
    head = CMSG_FIRSTHDR(&message);
    if (!head || head->cmsg_len != CMSG_LEN(sizeof lent))
        die("a command without its descriptors");
    memcpy(lent, CMSG_DATA(head), sizeof lent);
    while (slot < RUNNING_MAX && running[slot].pid)
        slot++;
    if (slot == RUNNING_MAX)
        die("too many commands at once");
    running[slot].report = lent[REPORT];
    running[slot].pid = fork();
    if (running[slot].pid < 0)
        die("fork");
    if (running[slot].pid == 0)
        run_client(command, (size_t)size_bytes, lent);
    report(lent[REPORT], running[slot].pid);
    close(lent[OUT]);
    close(lent[ERR]);
    return 1;
}

static void take_ends(void)
{
    int how;

    for (pid_t pid; (pid = waitpid(-1, &how, WNOHANG)) > 0;)
        for (int slot = 0; slot < RUNNING_MAX; slot++)
            if (running[slot].pid == pid) {
                report(running[slot].report, how);
                close(running[slot].report);
                running[slot].pid = 0;
            }
}

int __wrap_main(int argc, char **argv)
{
    struct pollfd looks[2];
    struct signalfd_siginfo ignored;
    sigset_t ends;

    if (argc != 2)
        die("usage: clients SOCKET");
    sigemptyset(&ends);
    sigaddset(&ends, SIGCHLD);
    sigprocmask(SIG_BLOCK, &ends, NULL);
    looks[0] = (struct pollfd){.fd = atoi(argv[1]), .events = POLLIN};
    looks[1] = (struct pollfd){.fd = signalfd(-1, &ends, SFD_CLOEXEC), .events = POLLIN};
    warm_up();
    for (;;) {
        if (poll(looks, 2, -1) < 0)
            die("poll");
        if (looks[1].revents && read(looks[1].fd, &ignored, sizeof ignored) > 0)
            take_ends();
        if (looks[0].revents && !take_command(looks[0].fd))
            return 0;
    }
}
