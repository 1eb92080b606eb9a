#include "web/base/wall.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <netinet/in.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

/* ---- Landlock ---------------------------------------------------------------------------------- */

/* The kernel's, of which older headers have the beginning only. */
struct ruleset {
    uint64_t files, network, scoped;
};
struct port_rule {
    uint64_t allowed, port;
};
enum {
    RULE_PORT = 2,
    NET_BIND = 1 << 0,
    NET_CONNECT = 1 << 1,
    SCOPE_ABSTRACT_SOCKET = 1 << 0,
    SCOPE_SIGNAL = 1 << 1,
    VERSION_NETWORK = 4,
    VERSION_SCOPES = 6,
};
/* All accesses to files of each version: execute, write, read, list, remove, make (1); rename (2); truncate (3); devices (5). */
static const uint64_t file_accesses[] = {0, 0x1fff, 0x3fff, 0x7fff, 0x7fff, 0xffff};

static long landlock_version(void)
{
    return syscall(SYS_landlock_create_ruleset, NULL, 0, LANDLOCK_CREATE_RULESET_VERSION);
}

int wall_allow(int rules, const char *path, uint64_t access)
{
    struct landlock_path_beneath_attr rule = {.allowed_access = access, .parent_fd = open(path, O_PATH | O_CLOEXEC)};
    int done;

    if (rule.parent_fd < 0)
        return 1;
    done = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) == 0;
    if (!done && errno == EINVAL) { /* a file has no right to be listed */
        rule.allowed_access &= WALL_OF_FILES;
        done = syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &rule, 0) == 0;
    }
    close(rule.parent_fd);
    return done;
}

int wall_allow_system(int rules)
{
    static const char *const readable[] = {
        "/usr/lib", "/usr/lib64", "/lib", "/lib64", "/usr/local/lib", "/nix", "/etc/ld.so.cache", "/etc/localtime",
        "/usr/share/zoneinfo", "/etc/ssl/openssl.cnf", "/etc/hosts", "/etc/host.conf", "/etc/nsswitch.conf", "/etc/resolv.conf",
        "/etc/gai.conf", "/proc/self", "/proc/meminfo", "/proc/cpuinfo", "/proc/stat", "/proc/sys/vm", "/sys/devices/system",
        "/sys/fs/cgroup", "/dev/null", "/dev/urandom"};
    static const char *const loaders[] = {"/lib64/ld-linux-x86-64.so.2", "/lib/ld-linux-aarch64.so.1"};

    for (size_t i = 0; i < sizeof readable / sizeof *readable; i++)
        if (!wall_allow(rules, readable[i], WALL_READS))
            return 0;
    for (size_t i = 0; i < sizeof loaders / sizeof *loaders; i++)
        if (!wall_allow(rules, loaders[i], WALL_EXECUTES))
            return 0;
    return 1;
}

static int restrict_access(const struct wall *wall)
{
    const struct port_rule port = {NET_CONNECT, wall->port};
    struct ruleset all = {0};
    long version = landlock_version();
    size_t size = version >= VERSION_SCOPES ? sizeof all : version >= VERSION_NETWORK ? 16 : 8;
    int rules, done, why;

    if (version < 1)
        return 1;
    all.files = file_accesses[version < 5 ? version : 5];
    all.network = version >= VERSION_NETWORK ? NET_BIND | NET_CONNECT : 0;
    all.scoped = version >= VERSION_SCOPES ? SCOPE_ABSTRACT_SOCKET | SCOPE_SIGNAL : 0;
    rules = (int)syscall(SYS_landlock_create_ruleset, &all, size, 0);
    if (rules < 0)
        return 0;
    done = wall_allow_system(rules) && wall_allow(rules, ".", WALL_READS) && wall_allow(rules, wall->program, WALL_EXECUTES) &&
           (!all.network || syscall(SYS_landlock_add_rule, rules, RULE_PORT, &port, 0) == 0) &&
           syscall(SYS_landlock_restrict_self, rules, 0) == 0;
    why = errno;
    close(rules);
    errno = why;
    return done;
}

/* ---- seccomp ----------------------------------------------------------------------------------- */

#if defined(__x86_64__)
enum { HAS_FILTER = 1 };
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
enum { HAS_FILTER = 1 };
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#else
enum { HAS_FILTER = 0 };
#define ARCHITECTURE 0
#endif

#define LOAD(member) BPF_STMT(BPF_LD | BPF_W | BPF_ABS, (uint32_t)offsetof(struct seccomp_data, member))
#define RETURN(what) BPF_STMT(BPF_RET | BPF_K, (what))
#define REFUSE RETURN(SECCOMP_RET_ERRNO | EPERM)
/* Refuse the call of this number; it is loaded. */
#define NO(call) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, SYS_##call, 0, 1), REFUSE
/* Go on after `next` more instructions where the loaded value is this. */
#define IF_IS(value, yes, no) BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, (value), yes, no)

static int filter_calls(int resolves)
{
    struct sock_filter filter[] = {
        LOAD(arch), IF_IS(ARCHITECTURE, 1, 0), RETURN(SECCOMP_RET_KILL_PROCESS),
        LOAD(nr),
#if defined(__x86_64__)
        BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, 0x40000000, 0, 1), REFUSE, /* the x32 calls */
#endif
        NO(ptrace), NO(process_vm_readv), NO(process_vm_writev), NO(kcmp), NO(pidfd_getfd), NO(pidfd_open), NO(execveat),
        NO(memfd_create), NO(bind), NO(listen), NO(accept), NO(accept4), NO(socketpair), NO(mount), NO(umount2),
        NO(pivot_root), NO(chroot), NO(unshare), NO(setns), NO(bpf), NO(perf_event_open), NO(add_key), NO(request_key),
        NO(keyctl), NO(io_uring_setup), NO(io_uring_enter), NO(io_uring_register), NO(userfaultfd), NO(init_module),
        NO(finit_module), NO(delete_module), NO(kexec_load), NO(open_by_handle_at), NO(name_to_handle_at), NO(reboot),
        NO(swapon), NO(swapoff), NO(personality), NO(quotactl), NO(acct), NO(syslog), NO(fanotify_init),
        IF_IS(SYS_socket, 1, 0), RETURN(SECCOMP_RET_ALLOW),
        /* A socket: of the internet, and of TCP. */
        LOAD(args[0]), IF_IS(AF_INET, 2, 0), IF_IS(AF_INET6, 1, 0), REFUSE,
        LOAD(args[1]), BPF_STMT(BPF_ALU | BPF_AND | BPF_K, 0xff), IF_IS(SOCK_STREAM, 2, 0),
        IF_IS(resolves ? SOCK_DGRAM : SOCK_STREAM, 1, 0), REFUSE,
        LOAD(args[2]), IF_IS(0, 3, 0), IF_IS(IPPROTO_TCP, 2, 0), IF_IS(resolves ? IPPROTO_UDP : IPPROTO_TCP, 1, 0), REFUSE,
        RETURN(SECCOMP_RET_ALLOW)};
    const struct sock_fprog program = {sizeof filter / sizeof *filter, filter};

    if (!HAS_FILTER || syscall(SYS_seccomp, SECCOMP_SET_MODE_FILTER, SECCOMP_FILTER_FLAG_TSYNC, &program) == 0)
        return 1;
    return errno == ENOSYS || errno == EINVAL; /* a kernel without it */
}

static int has_seccomp(void)
{
    const uint32_t action = SECCOMP_RET_ERRNO;

    return HAS_FILTER && syscall(SYS_seccomp, SECCOMP_GET_ACTION_AVAIL, 0, &action) == 0;
}

/* ---- both -------------------------------------------------------------------------------------- */

void wall_words(char *out, size_t size)
{
    long version = landlock_version();

    snprintf(out, size, "%s%s%s", version >= 1 ? "files" : "", version >= VERSION_NETWORK ? ", network" : "",
             has_seccomp() ? version >= 1 ? ", system calls" : "system calls" : "");
}

void wall_lacks(char *out, size_t size)
{
    const long version = landlock_version();
    const struct {
        int is_there;
        const char *words;
    } parts[] = {
        {version >= 1, "files (Landlock, Linux 5.13 or later)"},
        {version >= VERSION_NETWORK, "network (Landlock of Linux 6.7 or later)"},
        {version >= VERSION_SCOPES, "signals to other programs (Landlock of Linux 6.12 or later)"},
        {has_seccomp(), "system calls (seccomp)"},
    };

    out[0] = 0;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++)
        if (!parts[i].is_there && strlen(out) < size)
            snprintf(out + strlen(out), size - strlen(out), "%s%s", out[0] ? ", " : "", parts[i].words);
}

int wall_build(const struct wall *wall)
{
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 && restrict_access(wall) && filter_calls(wall->resolves);
}
