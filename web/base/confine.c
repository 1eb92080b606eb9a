#include "web/base/confine.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/landlock.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "common/system/log.h"
#include "web/base/wall.h"

/* A sanitizer reserves terabytes of addresses. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { LIMITS_MEMORY = 0 };
#else
enum { LIMITS_MEMORY = 1 };
#endif

enum { DESCRIPTORS_EACH = 3 }; /* a connection's, its own to the farm, and a file */

/* The hard limit stays: the program that reads uploaded scenes has limits of its own (child.h). */
static int limit(int what, uint64_t most)
{
    struct rlimit both;

    if (getrlimit((__rlimit_resource_t)what, &both) != 0)
        return 0;
    if (both.rlim_max == RLIM_INFINITY || both.rlim_max > most)
        both.rlim_cur = most;
    else
        both.rlim_cur = both.rlim_max;
    return setrlimit((__rlimit_resource_t)what, &both) == 0;
}

/* When memory runs out, the kernel ends this one first, and what it has started. */
static void be_first_to_go(void)
{
    int fd = open("/proc/self/oom_score_adj", O_WRONLY | O_CLOEXEC);

    if (fd < 0)
        return;
    if (write(fd, "1000", 4) < 0) {
        /* It then has our standing. */
    }
    close(fd);
}

/* ---- Landlock ---------------------------------------------------------------------------------- */

#define WRITES                                                                                                        \
    (LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_REMOVE_FILE |                 \
     LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG |                       \
     LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK |                    \
     LANDLOCK_ACCESS_FS_MAKE_SYM)
/* Renaming between folders, which is always forbidden before version 2 of Landlock. */
#define RENAMES ((uint64_t)1 << 13)

/* What removes large files (file_remove_apart). */
static int allow_removal(int rules)
{
    return wall_allow(rules, "/usr/bin/rm", WALL_EXECUTES) && wall_allow(rules, "/bin/rm", WALL_EXECUTES);
}

/* Keys may lie in /etc and, as a service's credentials, in /run: of these only what names are looked up in, where they are.
 * Such files are replaced, not written, so their folders. */
static int allow_names(int rules)
{
    static const char *const folders[] = {"/etc", "/run/systemd/resolve", "/run/resolvconf", "/run/NetworkManager/resolv.conf"};

    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++)
        if (!wall_allow(rules, folders[i], WALL_READS))
            return 0;
    return 1;
}

static int make_rules(int rules, const struct confinement *c)
{
    return wall_allow_system(rules) && wall_allow(rules, "/proc", WALL_READS) &&
           wall_allow(rules, "/dev/null", WALL_READS | LANDLOCK_ACCESS_FS_WRITE_FILE) &&
           wall_allow(rules, "/proc/self/exe", WALL_EXECUTES) && (!c->client || wall_allow(rules, c->client, WALL_EXECUTES)) &&
           allow_removal(rules) && (!c->resolves || allow_names(rules)) && wall_allow(rules, c->uploads, WALL_READS | WRITES | RENAMES);
}

/* 0: errno says why not. */
static int restrict_files(const struct confinement *c)
{
    const struct landlock_ruleset_attr all = {.handled_access_fs = WALL_READS | WALL_EXECUTES | WRITES | RENAMES};
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    int rules, done, why;

    if (version < 2) { /* uploads are renamed into their folders */
        errno = version < 0 ? errno : EOPNOTSUPP;
        return 0;
    }
    rules = (int)syscall(SYS_landlock_create_ruleset, &all, sizeof all, 0);
    if (rules < 0)
        return 0;
    done = make_rules(rules, c) && syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    why = errno;
    close(rules);
    errno = why;
    return done;
}

status confine(const struct confinement *c, struct error *err)
{
    uint64_t descriptors = (uint64_t)c->connections * DESCRIPTORS_EACH + WEB_DESCRIPTORS_MIN;

    be_first_to_go();
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || !limit(RLIMIT_CORE, 0) || !limit(RLIMIT_NOFILE, descriptors) ||
        (LIMITS_MEMORY && !limit(RLIMIT_AS, WEB_MEMORY_BYTES)))
        return error_set(err, STATUS_ERR_IO, "the program's limits cannot be set: %s", strerror(errno));
    if (!restrict_files(c))
        log_info("files are not kept from this program: the kernel has no Landlock (%s)", strerror(errno));
    return STATUS_OK;
}

status confine_to_parent(int64_t parent, struct error *err)
{
    /* It may have died before this call; then no one would send the signal. */
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != (pid_t)parent)
        return error_set(err, STATUS_ERR_REFUSED, "the coordinator that started this program has ended");
    return STATUS_OK;
}
