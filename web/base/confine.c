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

/* ---- Landlock ---------------------------------------------------------------------------------- */

#define READS (LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE | LANDLOCK_ACCESS_FS_READ_DIR)
#define WRITES                                                                                                        \
    (LANDLOCK_ACCESS_FS_WRITE_FILE | LANDLOCK_ACCESS_FS_REMOVE_DIR | LANDLOCK_ACCESS_FS_REMOVE_FILE |                 \
     LANDLOCK_ACCESS_FS_MAKE_CHAR | LANDLOCK_ACCESS_FS_MAKE_DIR | LANDLOCK_ACCESS_FS_MAKE_REG |                       \
     LANDLOCK_ACCESS_FS_MAKE_SOCK | LANDLOCK_ACCESS_FS_MAKE_FIFO | LANDLOCK_ACCESS_FS_MAKE_BLOCK |                    \
     LANDLOCK_ACCESS_FS_MAKE_SYM)
/* Renaming between folders, which is always forbidden before version 2 of Landlock. */
#define RENAMES ((uint64_t)1 << 13)

/* What is not there needs no rule. */
static int allow(int rules, const char *path, uint64_t access)
{
    struct landlock_path_beneath_attr rule = {.allowed_access = access,
                                              .parent_fd = open(path, O_PATH | O_CLOEXEC)};
    int done;

    if (rule.parent_fd < 0)
        return 1;
    done = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) == 0;
    close(rule.parent_fd);
    return done;
}

static int make_rules(int rules, const char *uploads, const char *client)
{
    static const char *const system[] = {"/usr", "/lib", "/lib64", "/bin", "/etc", "/proc", "/sys", "/run", "/opt", "/nix"};

    for (size_t i = 0; i < sizeof system / sizeof *system; i++)
        if (!allow(rules, system[i], READS))
            return 0;
    return allow(rules, "/dev", READS | LANDLOCK_ACCESS_FS_WRITE_FILE) &&
           allow(rules, "/proc/self/exe", LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE) &&
           (!client || allow(rules, client, LANDLOCK_ACCESS_FS_EXECUTE | LANDLOCK_ACCESS_FS_READ_FILE)) &&
           allow(rules, uploads, READS | WRITES | RENAMES);
}

/* 0: errno says why not. */
static int restrict_files(const char *uploads, const char *client)
{
    const struct landlock_ruleset_attr all = {.handled_access_fs = READS | WRITES | RENAMES};
    long version = syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
    int rules, done, why;

    if (version < 2) { /* uploads are renamed into their folders */
        errno = version < 0 ? errno : EOPNOTSUPP;
        return 0;
    }
    rules = (int)syscall(SYS_landlock_create_ruleset, &all, sizeof all, 0);
    if (rules < 0)
        return 0;
    done = make_rules(rules, uploads, client) && syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    why = errno;
    close(rules);
    errno = why;
    return done;
}

status confine(const char *uploads, const char *client, uint32_t connections, struct error *err)
{
    uint64_t descriptors = (uint64_t)connections * DESCRIPTORS_EACH + WEB_DESCRIPTORS_MIN;

    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 || !limit(RLIMIT_CORE, 0) || !limit(RLIMIT_NOFILE, descriptors) ||
        (LIMITS_MEMORY && !limit(RLIMIT_AS, WEB_MEMORY_BYTES)))
        return error_set(err, STATUS_ERR_IO, "the program's limits cannot be set: %s", strerror(errno));
    if (!restrict_files(uploads, client))
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
