/* odd_disk: preloaded into a program, makes calls on files fail as a bad disk would, without being root.
 *
 * ODD_DISK names a file that says what fails at the moment, one line: ERRNO KIND TEXT. KIND is "write"
 * (everything that makes or changes files and folders) or "any" (opening to read as well); TEXT is
 * part of the paths concerned. No file, or an empty one: nothing fails. It is read at every call, so a
 * test changes it as it goes.
 */
#undef _FORTIFY_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

/* 0, or the error that the call on the path gets. */
static int fault(const char *path, int writes)
{
    const char *control = getenv("ODD_DISK");
    char line[512], kind[8], text[256];
    int number = 0;
    long fd = control ? syscall(SYS_openat, AT_FDCWD, control, O_RDONLY | O_CLOEXEC) : -1;
    long got = fd >= 0 ? syscall(SYS_read, (int)fd, line, sizeof line - 1) : 0;

    if (fd >= 0)
        syscall(SYS_close, (int)fd);
    line[got > 0 ? got : 0] = 0;
    if (sscanf(line, "%d %7s %255s", &number, kind, text) != 3 || !strstr(path, text) ||
        (!writes && strcmp(kind, "any") != 0))
        return 0;
    errno = number;
    return number;
}

static int fd_fault(int fd)
{
    char link[64], path[4096];
    ssize_t got;

    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    got = readlink(link, path, sizeof path - 1);
    path[got > 0 ? got : 0] = 0;
    return fault(path, 1);
}

static void *next(const char *name)
{
    return dlsym(RTLD_NEXT, name);
}

#define WRITES(flags) (((flags) & O_ACCMODE) != O_RDONLY || ((flags) & O_CREAT))

#define OPEN(name)                                                          \
    EXPORT int name(const char *path, int flags, ...)                      \
    {                                                                       \
        int (*real)(const char *, int, ...) = (int (*)(const char *, int, ...))next(#name); \
        va_list args;                                                       \
        mode_t mode;                                                        \
        va_start(args, flags);                                              \
        mode = flags & O_CREAT ? va_arg(args, mode_t) : 0;                  \
        va_end(args);                                                       \
        return fault(path, WRITES(flags)) ? -1 : real(path, flags, mode);   \
    }
OPEN(open)
OPEN(open64)

#define MKOSTEMP(name)                                                      \
    EXPORT int name(char *path, int flags)                                  \
    {                                                                       \
        int (*real)(char *, int) = (int (*)(char *, int))next(#name);       \
        return fault(path, 1) ? -1 : real(path, flags);                     \
    }
MKOSTEMP(mkostemp)
MKOSTEMP(mkostemp64)

#define PWRITE(name)                                                        \
    EXPORT ssize_t name(int fd, const void *data, size_t size, off_t at)    \
    {                                                                       \
        ssize_t (*real)(int, const void *, size_t, off_t) =                 \
            (ssize_t (*)(int, const void *, size_t, off_t))next(#name);     \
        return fd_fault(fd) ? -1 : real(fd, data, size, at);                \
    }
PWRITE(pwrite)
PWRITE(pwrite64)

EXPORT ssize_t write(int fd, const void *data, size_t size)
{
    ssize_t (*real)(int, const void *, size_t) =
        (ssize_t (*)(int, const void *, size_t))next("write");

    return fd_fault(fd) ? -1 : real(fd, data, size);
}

EXPORT int fsync(int fd)
{
    int (*real)(int) = (int (*)(int))next("fsync");

    return fd_fault(fd) ? -1 : real(fd);
}

EXPORT int fdatasync(int fd)
{
    int (*real)(int) = (int (*)(int))next("fdatasync");

    return fd_fault(fd) ? -1 : real(fd);
}

#define FALLOCATE(name)                                                     \
    EXPORT int name(int fd, off_t at, off_t size)                           \
    {                                                                       \
        int (*real)(int, off_t, off_t) = (int (*)(int, off_t, off_t))next(#name); \
        int number = fd_fault(fd);                                          \
        return number ? number : real(fd, at, size);                        \
    }
FALLOCATE(posix_fallocate)
FALLOCATE(posix_fallocate64)

EXPORT int mkdir(const char *path, mode_t mode)
{
    int (*real)(const char *, mode_t) = (int (*)(const char *, mode_t))next("mkdir");

    return access(path, F_OK) != 0 && fault(path, 1) ? -1 : real(path, mode);
}

EXPORT int rename(const char *from, const char *to)
{
    int (*real)(const char *, const char *) = (int (*)(const char *, const char *))next("rename");

    return fault(to, 1) ? -1 : real(from, to);
}
