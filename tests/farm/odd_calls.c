/* odd_calls: preloaded into a program, makes its Nth call of a kind fail, as on a machine that is short of something.
 *
 * ODD_CALLS names a file of at least sizeof(struct control) bytes, which is mapped and shared with the test: it sets
 * `left` to N and then `kind`; the Nth call of that kind from then on fails, once. `calls` counts them.
 */
#undef _FORTIFY_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <link.h>
#include <malloc.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

#define EXPORT __attribute__((visibility("default")))

/* As in calls.py. OWN: the program's own allocations; ALLOC: those of its libraries as well. */
enum kind { NONE, OWN, ALLOC, MMAP, THREAD, OPEN, WRITE, SYNC, NAME, SQL };

struct control {
    atomic_llong kind, left, calls, failed;
};

static struct control *control;
static uintptr_t text_begin, text_end; /* of the program itself */

static int find_text(struct dl_phdr_info *info, size_t size, void *user)
{
    (void)size;
    (void)user;
    for (int i = 0; i < info->dlpi_phnum; i++) {
        const ElfW(Phdr) *part = &info->dlpi_phdr[i];
        if (part->p_type != PT_LOAD || !(part->p_flags & PF_X))
            continue;
        text_begin = info->dlpi_addr + part->p_vaddr;
        text_end = text_begin + part->p_memsz;
    }
    return 1; /* the first is the program */
}

__attribute__((constructor)) static void begin(void)
{
    const char *path = getenv("ODD_CALLS");
    int fd = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    void *map = fd >= 0 ? mmap(NULL, sizeof *control, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0) : MAP_FAILED;

    if (fd >= 0)
        close(fd);
    dl_iterate_phdr(find_text, NULL);
    unsetenv("LD_PRELOAD"); /* the page's program is not meant */
    if (map != MAP_FAILED)
        control = map;
}

static int fails(enum kind kind, int code)
{
    if (!control || atomic_load(&control->kind) != (long long)kind)
        return 0;
    atomic_fetch_add(&control->calls, 1);
    if (atomic_fetch_sub(&control->left, 1) != 1)
        return 0;
    atomic_fetch_add(&control->failed, 1);
    errno = code;
    return 1;
}

/* Is it the program itself that calls? */
static int is_own(const void *caller) { return (uintptr_t)caller >= text_begin && (uintptr_t)caller < text_end; }
#define IS_OWN() is_own(__builtin_return_address(0))

static void *next(const char *name) { return dlsym(RTLD_NEXT, name); }

/* ---- memory ---- */

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *old, size_t size);
void *__libc_memalign(size_t alignment, size_t size);

#define MEMORY_FAILS() ((IS_OWN() && fails(OWN, ENOMEM)) || fails(ALLOC, ENOMEM))

EXPORT void *malloc(size_t size) { return MEMORY_FAILS() ? NULL : __libc_malloc(size); }
EXPORT void *calloc(size_t count, size_t size) { return MEMORY_FAILS() ? NULL : __libc_calloc(count, size); }
EXPORT void *realloc(void *old, size_t size) { return MEMORY_FAILS() ? NULL : __libc_realloc(old, size); }
EXPORT void *memalign(size_t a, size_t size) { return MEMORY_FAILS() ? NULL : __libc_memalign(a, size); }
EXPORT void *aligned_alloc(size_t a, size_t size) { return MEMORY_FAILS() ? NULL : __libc_memalign(a, size); }
EXPORT int posix_memalign(void **out, size_t alignment, size_t size)
{
    void *block = MEMORY_FAILS() ? NULL : __libc_memalign(alignment, size);

    if (block)
        *out = block;
    return block ? 0 : ENOMEM;
}

/* Libraries that reserve address space once and cannot do without are loaded before a test arms anything. */
EXPORT void *mmap(void *at, size_t size, int protection, int flags, int fd, off_t offset)
{
    return fails(MMAP, ENOMEM) ? MAP_FAILED
                               : ((void *(*)(void *, size_t, int, int, int, off_t))next("mmap"))(at, size, protection,
                                                                                                 flags, fd, offset);
}

/* ---- threads ---- */

EXPORT int pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*run)(void *), void *user)
{
    return fails(THREAD, EAGAIN) ? EAGAIN
                                 : ((int (*)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *))next(
                                       "pthread_create"))(thread, how, run, user);
}

/* ---- files ---- */

#define OPENS(name)                                                                                   \
    EXPORT int name(const char *path, int flags, ...)                                                 \
    {                                                                                                 \
        va_list args;                                                                                 \
        mode_t mode;                                                                                  \
        va_start(args, flags);                                                                        \
        mode = flags & O_CREAT ? va_arg(args, mode_t) : 0;                                            \
        va_end(args);                                                                                 \
        return fails(OPEN, EMFILE) ? -1                                                               \
                                   : ((int (*)(const char *, int, ...))next(#name))(path, flags, mode); \
    }
OPENS(open)
OPENS(open64)

#define MKOSTEMPS(name)                                                                                  \
    EXPORT int name(char *path, int flags)                                                               \
    {                                                                                                    \
        return fails(OPEN, EMFILE) ? -1 : ((int (*)(char *, int))next(#name))(path, flags);              \
    }
MKOSTEMPS(mkostemp)
MKOSTEMPS(mkostemp64)

static int is_file(int fd)
{
    struct stat info;

    return fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
}

EXPORT ssize_t write(int fd, const void *data, size_t size)
{
    return is_file(fd) && fails(WRITE, ENOSPC) ? -1
                                               : ((ssize_t(*)(int, const void *, size_t))next("write"))(fd, data, size);
}

#define PWRITES(name)                                                                                        \
    EXPORT ssize_t name(int fd, const void *data, size_t size, off_t at)                                     \
    {                                                                                                        \
        return fails(WRITE, ENOSPC)                                                                          \
                   ? -1                                                                                      \
                   : ((ssize_t(*)(int, const void *, size_t, off_t))next(#name))(fd, data, size, at);         \
    }
PWRITES(pwrite)
PWRITES(pwrite64)

EXPORT int ftruncate(int fd, off_t size)
{
    return is_file(fd) && fails(WRITE, ENOSPC) ? -1 : ((int (*)(int, off_t))next("ftruncate"))(fd, size);
}

EXPORT int fsync(int fd) { return fails(SYNC, EIO) ? -1 : ((int (*)(int))next("fsync"))(fd); }
EXPORT int fdatasync(int fd) { return fails(SYNC, EIO) ? -1 : ((int (*)(int))next("fdatasync"))(fd); }

EXPORT int rename(const char *from, const char *to)
{
    return fails(NAME, EIO) ? -1 : ((int (*)(const char *, const char *))next("rename"))(from, to);
}
EXPORT int mkdir(const char *path, mode_t mode)
{
    return fails(NAME, EIO) ? -1 : ((int (*)(const char *, mode_t))next("mkdir"))(path, mode);
}
EXPORT int unlink(const char *path) { return fails(NAME, EIO) ? -1 : ((int (*)(const char *))next("unlink"))(path); }

/* ---- the database: a step that does nothing; not one inside sqlite3_exec, which would take it for done ---- */

struct sqlite3;
struct sqlite3_stmt;
int sqlite3_step(struct sqlite3_stmt *statement);
int sqlite3_exec(struct sqlite3 *db, const char *sql, int (*row)(void *, int, char **, char **), void *user, char **why);
enum { SQLITE_IOERR = 10 };

EXPORT int sqlite3_step(struct sqlite3_stmt *statement)
{
    return IS_OWN() && fails(SQL, EIO) ? SQLITE_IOERR : ((int (*)(struct sqlite3_stmt *))next("sqlite3_step"))(statement);
}

EXPORT int sqlite3_exec(struct sqlite3 *db, const char *sql, int (*row)(void *, int, char **, char **), void *user,
                        char **why)
{
    return IS_OWN() && fails(SQL, EIO)
               ? SQLITE_IOERR
               : ((int (*)(struct sqlite3 *, const char *, int (*)(void *, int, char **, char **), void *,
                           char **))next("sqlite3_exec"))(db, sql, row, user, why);
}
