/* odd_disk: preloaded into a program, makes calls on files fail as a bad disk would, without being root.
 *
 * ODD_DISK names a file that says what fails at the moment, one line: ERRNO KIND TEXT. KIND is "write"
 * (everything that makes or changes files and folders), "any" (opening to read as well), "sync" (fsync and fdatasync
 * alone) or "data" (fdatasync alone); TEXT is part of the paths concerned. Zeros: nothing fails.
 *
 * STALLED_DISK names a file that says which paths hang, by a part of them: a call that syncs or writes at a place
 * (fsync, fdatasync, pwrite) does not return while it says so; after "data " fdatasync alone. Zeros: nothing hangs.
 *
 * Both have CONTROL_BYTES, are mapped when the program starts, so that one behind Landlock sees them, and are read at every
 * call, so that a test changes them as it goes.
 *
 * SLOW_REMOVAL=MS,BYTES: freeing the room of a file larger than BYTES takes MS milliseconds, as on ext4 with
 * discard: where its last name goes, or the last descriptor of one without a name. While the file ODD_DISK-fast is there
 * it takes none.
 *
 * LATE_DISK=database,MS: each change of a database is written so much later; LATE_DISK=sync,MS: each fsync and fdatasync
 * begins so much later (make steady LATE=).
 */
#undef _FORTIFY_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

enum { READS, WRITES, SYNCS, SYNCS_DATA };

enum { CONTROL_BYTES = 256 };

static const char *odd, *stalled; /* what the files say, or NULL */

static const char *control_of(const char *variable)
{
    const char *name = getenv(variable);
    struct stat info;
    long fd = name ? syscall(SYS_openat, AT_FDCWD, name, O_RDONLY | O_CLOEXEC) : -1;
    void *at = MAP_FAILED;

    if (fd < 0)
        return NULL;
    if (fstat((int)fd, &info) == 0 && info.st_size == CONTROL_BYTES)
        at = mmap(NULL, CONTROL_BYTES, PROT_READ, MAP_SHARED, (int)fd, 0);
    syscall(SYS_close, (int)fd);
    return at == MAP_FAILED ? NULL : at;
}

__attribute__((constructor)) static void find_controls(void)
{
    odd = control_of("ODD_DISK");
    stalled = control_of("STALLED_DISK");
}

/* What a control says now; empty where there is none. */
static void read_control(char text[CONTROL_BYTES], const char *control)
{
    text[0] = 0;
    if (control)
        memcpy(text, control, CONTROL_BYTES);
    text[CONTROL_BYTES - 1] = 0;
}

/* 0, or the error that the call on the path gets. */
static int fault(const char *path, int call)
{
    char line[CONTROL_BYTES], kind[8], text[CONTROL_BYTES];
    int number = 0;

    read_control(line, odd);
    if (sscanf(line, "%d %7s %255s", &number, kind, text) != 3 || !strstr(path, text) ||
        (call == READS && strcmp(kind, "any") != 0) || (call < SYNCS && strcmp(kind, "sync") == 0) ||
        (call != SYNCS_DATA && strcmp(kind, "data") == 0))
        return 0;
    errno = number;
    return number;
}

static void fd_path(int fd, char *path, size_t size)
{
    char link[64];
    ssize_t got;

    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    got = readlink(link, path, size - 1);
    path[got > 0 ? got : 0] = 0;
}

static int fd_fault_of(int fd, int call)
{
    char path[4096];

    fd_path(fd, path, sizeof path);
    return fault(path, call);
}

static int fd_fault(int fd) { return fd_fault_of(fd, WRITES); }

/* Does such a call on the path hang now? */
static int hangs(const char *path, int call)
{
    static const char data[] = "data ";
    char text[CONTROL_BYTES];

    read_control(text, stalled);
    if (strncmp(text, data, sizeof data - 1) == 0)
        return call == SYNCS_DATA && strstr(path, text + sizeof data - 1) != NULL;
    return text[0] && strstr(path, text) != NULL;
}

/* Wait while the disk that holds the file hangs. */
static void stall(int fd, int call)
{
    char path[4096];
    int code = errno;

    if (!stalled)
        return;
    fd_path(fd, path, sizeof path);
    while (hangs(path, call))
        nanosleep(&(struct timespec){0, 5000000}, NULL);
    errno = code;
}

/* Wait before a call on the file, if calls of this kind are late. */
static void wait_if_late(int fd, const char *kind)
{
    enum { CHANGE_NS = 50000000 }; /* pages of one change follow each other faster */
    static _Thread_local long long waited_ns;
    const char *how = getenv("LATE_DISK");
    size_t length = strlen(kind);
    struct timespec now;
    char path[4096];
    int code = errno;
    long ms;

    if (!how || strncmp(how, kind, length) != 0 || sscanf(how + length, ",%ld", &ms) != 1)
        return;
    fd_path(fd, path, sizeof path);
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (strcmp(kind, "sync") == 0 ||
        (strstr(path, ".sqlite") && now.tv_sec * 1000000000LL + now.tv_nsec - waited_ns > CHANGE_NS))
        nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000}, NULL);
    clock_gettime(CLOCK_MONOTONIC, &now);
    waited_ns = now.tv_sec * 1000000000LL + now.tv_nsec;
    errno = code;
}

static void *next(const char *name) { return dlsym(RTLD_NEXT, name); }

#define CALL(flags) (((flags) & O_ACCMODE) != O_RDONLY || ((flags) & O_CREAT))

#define OPEN(name)                                                          \
    EXPORT int name(const char *path, int flags, ...)                      \
    {                                                                       \
        int (*real)(const char *, int, ...) = (int (*)(const char *, int, ...))next(#name); \
        va_list args;                                                       \
        mode_t mode;                                                        \
        va_start(args, flags);                                              \
        mode = flags & O_CREAT ? va_arg(args, mode_t) : 0;                  \
        va_end(args);                                                       \
        return fault(path, CALL(flags) ? WRITES : READS) ? -1 : real(path, flags, mode);   \
    }
OPEN(open)
OPEN(open64)

#define MKOSTEMP(name)                                                      \
    EXPORT int name(char *path, int flags)                                  \
    {                                                                       \
        int (*real)(char *, int) = (int (*)(char *, int))next(#name);       \
        return fault(path, WRITES) ? -1 : real(path, flags);                     \
    }
MKOSTEMP(mkostemp)
MKOSTEMP(mkostemp64)

#define PWRITE(name)                                                        \
    EXPORT ssize_t name(int fd, const void *data, size_t size, off_t at)    \
    {                                                                       \
        ssize_t (*real)(int, const void *, size_t, off_t) =                 \
            (ssize_t (*)(int, const void *, size_t, off_t))next(#name);     \
        stall(fd, WRITES);                                                  \
        wait_if_late(fd, "database");                                       \
        return fd_fault(fd) ? -1 : real(fd, data, size, at);                \
    }
PWRITE(pwrite)
PWRITE(pwrite64)

EXPORT ssize_t write(int fd, const void *data, size_t size)
{
    ssize_t (*real)(int, const void *, size_t) = (ssize_t(*)(int, const void *, size_t))next("write");

    return fd_fault(fd) ? -1 : real(fd, data, size);
}

EXPORT int fsync(int fd)
{
    int (*real)(int) = (int (*)(int))next("fsync");

    stall(fd, SYNCS);
    wait_if_late(fd, "sync");
    return fd_fault_of(fd, SYNCS) ? -1 : real(fd);
}

EXPORT int fdatasync(int fd)
{
    int (*real)(int) = (int (*)(int))next("fdatasync");

    stall(fd, SYNCS_DATA);
    wait_if_late(fd, "sync");
    return fd_fault_of(fd, SYNCS_DATA) ? -1 : real(fd);
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

    return access(path, F_OK) != 0 && fault(path, WRITES) ? -1 : real(path, mode);
}

EXPORT int rename(const char *from, const char *to)
{
    int (*real)(const char *, const char *) = (int (*)(const char *, const char *))next("rename");

    return fault(to, 1) ? -1 : real(from, to);
}

/* ---- slow removals ---- */

static void free_room(const struct stat *file)
{
    const char *how = getenv("SLOW_REMOVAL"), *control = getenv("ODD_DISK");
    enum { STEP_MS = 20 };
    char fast[4096];
    long ms, bytes;

    snprintf(fast, sizeof fast, "%s-fast", control ? control : "");
    if (how && sscanf(how, "%ld,%ld", &ms, &bytes) == 2 && S_ISREG(file->st_mode) && (long)file->st_size > bytes)
        for (; ms > 0 && syscall(SYS_access, fast, F_OK) != 0; ms -= STEP_MS)
            nanosleep(&(struct timespec){0, STEP_MS * 1000000}, NULL);
}

static int is_open(const struct stat *file)
{
    struct stat info;

    for (int fd = 0; fd < 1024; fd++)
        if (fstat(fd, &info) == 0 && info.st_ino == file->st_ino && info.st_dev == file->st_dev)
            return 1;
    return 0;
}

static void free_name(int folder, const char *path)
{
    struct stat file;
    int code = errno;

    if (getenv("SLOW_REMOVAL") && fstatat(folder, path, &file, AT_SYMLINK_NOFOLLOW) == 0 && file.st_nlink == 1 &&
        !is_open(&file))
        free_room(&file);
    errno = code;
}

EXPORT int unlink(const char *path)
{
    free_name(AT_FDCWD, path);
    return ((int (*)(const char *))next("unlink"))(path);
}

EXPORT int remove(const char *path)
{
    free_name(AT_FDCWD, path);
    return ((int (*)(const char *))next("remove"))(path);
}

EXPORT int unlinkat(int folder, const char *path, int flags)
{
    free_name(folder, path);
    return ((int (*)(int, const char *, int))next("unlinkat"))(folder, path, flags);
}

EXPORT int close(int fd)
{
    struct stat file;
    int code = errno;

    if (getenv("SLOW_REMOVAL") && fstat(fd, &file) == 0 && file.st_nlink == 0)
        free_room(&file);
    errno = code;
    return ((int (*)(int))next("close"))(fd);
}
