/* Uploads: names, options and words of the importer (import_check.h), and programs run under limits (child.h). */
#include <arpa/inet.h>
#include <fcntl.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <sched.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "client/commands/command.h"
#include "common/system/clock.h"
#include "common/system/file.h"
#include "web/base/wall.h"
#include "web/uploads/child.h"
#include "web/uploads/import_check.h"
#include "tests/support/scratch_folder.h"

/* ---- names -------------------------------------------------------------------------------- */

static void plain_paths_are_taken(void **state)
{
    static const char *const good[] = {"a", "scene.gltf", "textures/wood.png", "a b/ç~$.png", "-o", "..a/b..", "...",
                                       "a\\b", "C:/x"};
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        assert_int_equal(import_path_check(good[i], &err), STATUS_OK);
}

static void paths_that_lead_elsewhere_are_refused(void **state)
{
    static const char *const bad[] = {"", "/", "/etc/passwd", "..", "../x", "a/../b", "a/..", "./a", "a/.", "a//b", "a/",
                                      "a\nb", "a\x7f", "\x1b[2J", "a/\xff\xfe", "\xc0\xaf"};
    char deep[200] = "", name[400];
    struct error err = {0};

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        memset(&err, 0, sizeof err);
        assert_int_equal(import_path_check(bad[i], &err), STATUS_ERR_USAGE);
        assert_true(err.text[0]);
    }
    for (int i = 0; i < IMPORT_DEPTH_MAX; i++)
        strcat(deep, "a/");
    deep[2 * IMPORT_DEPTH_MAX - 1] = 0;
    assert_int_equal(import_path_check(deep, &err), STATUS_OK);
    strcat(deep, "/a");
    assert_int_equal(import_path_check(deep, &err), STATUS_ERR_USAGE);
    memset(name, 'n', sizeof name);
    name[IMPORT_NAME_MAX] = 0;
    assert_int_equal(import_path_check(name, &err), STATUS_OK);
    name[IMPORT_NAME_MAX] = 'n';
    name[IMPORT_NAME_MAX + 1] = 0;
    assert_int_equal(import_path_check(name, &err), STATUS_ERR_USAGE);
}

/* ---- options ------------------------------------------------------------------------------ */

static status read_words(struct import_words *words, const char *text, struct error *err)
{
    json_t *options = json_loads(text, 0, NULL);
    status s = import_words_read(words, options, err);

    assert_non_null(options);
    json_decref(options);
    return s;
}

static void options_become_single_words(void **state)
{
    struct import_words words = {0};
    struct error err = {0};

    (void)state;
    assert_int_equal(read_words(&words,
                                "[\"--spp\", \"64\", \"--size=32x32\", \"--alpha\", \"--name\", \"--output\","
                                " \"--env\", \"sky.exr\", \"--name=a=b\"]", &err), STATUS_OK);
    assert_int_equal(words.count, 6);
    assert_string_equal(words.items[0], "--spp=64");
    assert_string_equal(words.items[1], "--size=32x32");
    assert_string_equal(words.items[2], "--alpha");
    assert_string_equal(words.items[3], "--name=--output"); /* a value is never an option */
    assert_string_equal(words.items[4], "--env=./sky.exr");
    assert_string_equal(words.items[5], "--name=a=b");
    import_words_release(&words);
    assert_int_equal(import_words_read(&words, NULL, &err), STATUS_OK);
    assert_int_equal(words.count, 0);
}

static void other_options_are_refused_by_name(void **state)
{
    static const char *const bad[] = {
        "[\"-o\", \"x\"]", "[\"--output=x\"]", "[\"--follow\"]", "[\"--watch\"]", "[\"--key\", \"/etc/passwd\"]",
        "[\"--coordinator=1.2.3.4\"]", "[\"--allow-outside=/\"]", "[\"--schedule-from=/x.exr\"]",
        "[\"--token=x\"]", "[\"--owner=root\"]", "[\"--force\"]", "[\"--\"]", "[\"--help\"]", "[\"x\"]", "[\"\"]",
        "[\"--spp\"]", "[\"--alpha=1\"]", "[7]", "{}", "[\"--spp\", 7]", "[\"--env=/etc/passwd\"]",
        "[\"--env=../x\"]", "[\"--lut\", \"a/../../b\"]", "[\"--name=a\\nb\"]", "[\"--sp=6\"]"};

    (void)state;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        struct import_words words = {0};
        struct error err = {0};
        assert_int_equal(read_words(&words, bad[i], &err), STATUS_ERR_USAGE);
        assert_non_null(strstr(err.text, "options"));
        import_words_release(&words);
    }
}

static int is_taken(const struct option *o)
{
    const char *value = o->kind == OPTION_CHOICE ? o->choices : "1";
    struct import_words words = {0};
    struct error err = {0};
    char text[256];
    status s;

    if (o->kind == OPTION_FLAG)
        snprintf(text, sizeof text, "[\"--%s\"]", o->name);
    else
        snprintf(text, sizeof text, "[\"--%s\", \"%.*s\"]", o->name, (int)strcspn(value, "|"), value);
    s = read_words(&words, text, &err);
    import_words_release(&words);
    return s == STATUS_OK;
}

/* An option of submit can be given with an upload, unless it is one of these. */
static void take_submit(void *user, const char *usage, const struct option *table)
{
    static const char *const kept[] = {
        "allow-outside", "only-below", "max-image", "max-image-memory", "schedule-from", /* the machine's own files, its memory */
        "effects", /* auto measures on the farm first */
        "output", "follow", "video", "watch", "json", "quiet", "reconnect", "timeout", /* of the command, not of the job */
        "coordinator", "key", "token", "owner", "force"};
    size_t found = 0, count = sizeof kept / sizeof *kept;

    (void)usage;
    for (const struct option *o = table; o->name && o->kind != OPTION_GROUP; o++) {
        int is_kept = 0;
        for (size_t i = 0; i < count; i++)
            is_kept |= strcmp(o->name, kept[i]) == 0;
        found += (size_t)is_kept;
        if (is_taken(o) == is_kept)
            fail_msg("--%s %s", o->name, is_kept ? "is taken" : "is refused");
    }
    assert_int_equal(found, count);
    *(int *)user = 1;
}

static void options_are_those_of_submit(void **state)
{
    char submit[] = "submit", help[] = "--help", *const argv[] = {submit, help, NULL};
    struct error err = {0};
    int exit_code = 0, seen = 0;

    (void)state;
    options_take_help(take_submit, &seen);
    assert_int_equal(command_submit.run(&command_submit, 2, argv, &exit_code, &err), STATUS_OK);
    options_take_help(NULL, NULL);
    assert_true(seen);
}

/* ---- what the importer says --------------------------------------------------------------- */

static void expect_sentence(const char *printed, const char *expected)
{
    char text[512];

    import_sentence(text, sizeof text, printed, "/srv/store/imports/7");
    assert_string_equal(text, expected);
}

static void errors_name_no_folder_of_the_server(void **state)
{
    (void)state;
    expect_sentence("warning: x\nazulejo submit: ./a.gltf: bad JSON in line 3\n", "a.gltf: bad JSON in line 3");
    expect_sentence("azulejo submit: /srv/store/imports/7/files/a.obj: no faces\n", "files/a.obj: no faces");
    expect_sentence("azulejo submit: --spp: must be a number ('azulejo submit --help' shows more)\n",
                    "--spp: must be a number");
    expect_sentence("azulejo: out of memory\n", "out of memory"); /* client/terminal/must.h */
    expect_sentence("", "");
    expect_sentence("Segmentation fault\n", "");
}

static void missing_files_are_to_be_uploaded(void **state)
{
    (void)state;
    expect_sentence("azulejo submit: ./a.gltf: image 0: /etc/shadow: cannot be opened: it is not below the folder of --only-below\n",
                    "a.gltf: image 0: /etc/shadow: is not among the uploaded files: upload it, too, where the scene looks for it");
    expect_sentence("azulejo submit: ./a.pbrt:1: the file \"b.pbrt\" does not exist\n",
                    "a.pbrt:1: the file \"b.pbrt\": is not among the uploaded files: upload it, too, where the scene looks for it");
}

static void warnings_are_listed(void **state)
{
    json_t *warnings =
        import_warnings("takes 1 file\nwarning: ./a.obj: no normals\nwarning: b\x1b[1m\nazulejo submit: x\n", "/srv");

    (void)state;
    assert_int_equal(json_array_size(warnings), 2);
    assert_string_equal(json_string_value(json_array_get(warnings, 0)), "a.obj: no normals");
    assert_string_equal(json_string_value(json_array_get(warnings, 1)), "b?[1m");
    json_decref(warnings);
}

/* ---- programs under limits ---------------------------------------------------------------- */

struct outcome {
    int ends;
    enum web_child_end end;
    int64_t exit_status;
    int signal;
    char output[256], errors[256];
};

static void on_end(void *user, const struct web_child_result *r)
{
    struct outcome *o = user;

    o->ends++;
    o->end = r->end;
    o->exit_status = r->exit_status;
    o->signal = r->signal;
    snprintf(o->output, sizeof o->output, "%s", buffer_text(r->output));
    snprintf(o->errors, sizeof o->errors, "%s", buffer_text(r->errors));
}

static const char *words[] = {"sh", "-c", NULL, NULL};
static const char *const environment[] = {"PATH=/usr/bin:/bin", "COLOUR=blue", NULL};
static struct web_child_options options_of(const char *script)
{
    words[2] = script;
    return (struct web_child_options){.program = "/bin/sh", .arguments = words, .environment = environment, .folder = "/",
                                  .secret = -1, .processor_s = 100, .file_bytes = 0, .limit_ms = 60000,
                                  .output_bytes = 1 << 16};
}

/* Run it on a loop of its own until nothing is left. */
static struct outcome run(const struct web_child_options *options, void (*meanwhile)(struct web_child *child))
{
    struct outcome o = {0};
    struct web_child *child;
    struct error err = {0};
    uv_loop_t loop;

    assert_int_equal(uv_loop_init(&loop), 0);
    assert_int_equal(web_child_start(&child, &loop, options, on_end, &o, &err), STATUS_OK);
    if (meanwhile)
        meanwhile(child);
    assert_int_equal(uv_run(&loop, UV_RUN_DEFAULT), 0);
    assert_int_equal(uv_loop_close(&loop), 0);
    return o;
}

static void a_program_gives_its_output_and_status(void **state)
{
    struct web_child_options how = options_of("pwd; echo $COLOUR; echo oh >&2; exit 5");
    struct outcome o = run(&how, NULL);

    (void)state;
    assert_int_equal(o.ends, 1);
    assert_int_equal(o.end, CHILD_EXITED);
    assert_int_equal(o.exit_status, 5);
    assert_string_equal(o.output, "/\nblue\n");
    assert_string_equal(o.errors, "oh\n");
}

static void a_program_that_is_not_there_says_so(void **state)
{
    struct web_child_options how = options_of("true");
    struct outcome o;

    (void)state;
    how.program = "/nowhere/azulejo";
    o = run(&how, NULL);
    assert_int_equal(o.exit_status, 127);
    assert_non_null(strstr(o.errors, "/nowhere/azulejo: cannot be run"));
}

static void only_the_secret_is_inherited(void **state)
{
    struct web_child_options how = options_of("cat <&3; ls /proc/self/fd | wc -l");
    int stray = dup(0); /* not closed on exec */
    int pipes[2];
    struct outcome o;

    (void)state;
    assert_int_equal(pipe(pipes), 0);
    assert_int_equal(write(pipes[1], "key\n", 4), 4);
    close(pipes[1]);
    how.secret = pipes[0];
    o = run(&how, NULL);
    close(pipes[0]);
    close(stray);
    assert_string_equal(o.output, "key\n5\n"); /* three, the secret, and the folder that ls reads */
}

static void limits_are_kept(void **state)
{
    struct web_child_options how = options_of("sleep 100");
    struct outcome o;

    (void)state;
    how.limit_ms = 50;
    o = run(&how, NULL);
    assert_int_equal(o.end, CHILD_TOO_LONG);
    how = options_of("sleep 100 & sleep 100"); /* a child of its own holds its output open */
    how.limit_ms = 50;
    o = run(&how, NULL);
    assert_int_equal(o.end, CHILD_TOO_LONG);
    how = options_of("while :; do :; done");
    how.processor_s = 1;
    o = run(&how, NULL);
    assert_int_equal(o.end, CHILD_EXITED);
    assert_true(o.signal == SIGXCPU || o.signal == SIGKILL);
    how = options_of("while :; do echo aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa; done");
    o = run(&how, NULL);
    assert_int_equal(o.end, CHILD_TOO_MUCH);
    how = options_of("f=${TMPDIR:-/tmp}/azulejo-test-import-$$; /bin/echo x >$f; s=$?; rm -f $f; exit $s");
    o = run(&how, NULL);
    assert_int_not_equal(o.exit_status, 0);
}

static void much_on_standard_error_ends_nothing(void **state)
{
    struct web_child_options how = options_of("i=0; while [ $i -lt 20000 ]; do echo $i-aaaaaaaaaaaaaaaaaaa >&2; i=$((i+1)); done");
    struct outcome o = run(&how, NULL);

    (void)state;
    assert_int_equal(o.end, CHILD_EXITED);
    assert_int_equal(o.exit_status, 0);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
static void memory_is_limited(void **state)
{
    struct web_child_options how = options_of("x=$(head -c 200000000 /dev/zero | tr '\\0' x); echo ${#x}");
    struct outcome o = run(&how, NULL);

    (void)state;
    assert_string_equal(o.output, "200000000\n");
    how.memory_bytes = 100 << 20;
    o = run(&how, NULL);
    assert_string_not_equal(o.output, "200000000\n");
}
#endif

static void an_end_is_told_once_after_a_kill(void **state)
{
    struct web_child_options how = options_of("sleep 100");
    struct outcome o = run(&how, web_child_kill);

    (void)state;
    assert_int_equal(o.ends, 1);
    assert_int_equal(o.end, CHILD_KILLED);
}

static void nothing_is_told_after_it_was_abandoned(void **state)
{
    struct web_child_options how = options_of("sleep 100");
    struct outcome o = run(&how, web_child_abandon);

    (void)state;
    assert_int_equal(o.ends, 0);
}

static void nobody(void *user, const struct web_child_result *r)
{
    (void)user;
    (void)r;
}

/* A process that starts a child is killed: the child's end of the pipe goes with it. */
static void it_dies_with_the_coordinator(void **state)
{
    char script[128], byte;
    int pipes[2], status_;
    pid_t parent;

    (void)state;
    assert_int_equal(pipe(pipes), 0);
    parent = fork();
    if (parent == 0) {
        struct web_child_options how;
        struct web_child *child;
        uv_loop_t loop;
        close(pipes[0]);
        snprintf(script, sizeof script, "echo ready >&3; exec sleep 100");
        how = options_of(script);
        how.secret = pipes[1];
        if (uv_loop_init(&loop) == 0 && web_child_start(&child, &loop, &how, nobody, NULL, NULL) == STATUS_OK) {
            close(pipes[1]);
            uv_run(&loop, UV_RUN_DEFAULT);
        }
        _exit(1);
    }
    close(pipes[1]);
    assert_int_equal(read(pipes[0], &byte, 1), 1);
    assert_int_equal(kill(parent, SIGKILL), 0);
    assert_int_equal(waitpid(parent, &status_, 0), parent);
    while (read(pipes[0], &byte, 1) > 0) {
        /* "eady\n", then the end of the last process that had the pipe. */
    }
    close(pipes[0]);
}

/* ---- behind a wall ------------------------------------------------------------------------ */

/* A listener of 127.0.0.1. */
static int listen_somewhere(uint16_t *port)
{
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}};
    socklen_t size = sizeof address;
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);

    assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
    assert_int_equal(listen(fd, 8), 0);
    assert_int_equal(getsockname(fd, (struct sockaddr *)&address, &size), 0);
    *port = ntohs(address.sin_port);
    return fd;
}

static int can_connect(uint16_t port)
{
    const struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr = {htonl(INADDR_LOOPBACK)}, .sin_port = htons(port)};
    int fd = socket(AF_INET, SOCK_STREAM, 0);

    return fd >= 0 && connect(fd, (const struct sockaddr *)&address, sizeof address) == 0;
}

static int can_open(const char *path, int flags) { return open(path, flags | O_CLOEXEC, 0600) >= 0; }

static int can_execute(void)
{
    int ended = 0;
    pid_t pid = fork();

    if (pid == 0) {
        execl("/bin/true", "true", (char *)NULL);
        _exit(99);
    }
    return waitpid(pid, &ended, 0) == pid && WIFEXITED(ended) && WEXITSTATUS(ended) == 0;
}

/* What the child can do, a letter each. */
static int try_all(char **argv)
{
    if (can_open("scene.gltf", O_RDONLY)) putchar('s');
    if (can_open(argv[4], O_RDONLY)) putchar('o'); /* another upload's */
    if (can_open("/etc/passwd", O_RDONLY)) putchar('p');
    if (can_open("made", O_WRONLY | O_CREAT)) putchar('w');
    if (can_execute()) putchar('x');
    if (can_connect((uint16_t)atoi(argv[2]))) putchar('c');
    if (can_connect((uint16_t)atoi(argv[3]))) putchar('n');
    if (socket(AF_UNIX, SOCK_STREAM, 0) >= 0) putchar('u');
    if (socket(AF_INET, SOCK_DGRAM, 0) >= 0) putchar('d');
    if (ptrace(PTRACE_TRACEME, 0, NULL, NULL) == 0) putchar('t');
    if (unshare(CLONE_NEWUSER) == 0) putchar('m');
    return fflush(stdout);
}

static void strangers_files_are_read_behind_a_wall(void **state)
{
#ifdef __SANITIZE_ADDRESS__
    skip(); /* its runtime asks for what the wall forbids */
#endif
    char folder[SCRATCH_PATH], own[64], other[128], ports[2][16], self[4096] = "", *has;
    const char *arguments[] = {"test", "try-all", ports[0], ports[1], other, NULL};
    struct web_child_options how = options_of("");
    char kernel[64];
    uint16_t farm, foreign;
    int listeners[2] = {listen_somewhere(&farm), listen_somewhere(&foreign)};
    struct outcome o;

    (void)state;
    assert_true(readlink("/proc/self/exe", self, sizeof self - 1) > 0);
    scratch_folder(folder);
    snprintf(own, sizeof own, "%s/own", folder);
    snprintf(other, sizeof other, "%s/own/scene.gltf", folder);
    assert_int_equal(mkdir(own, 0700), 0);
    assert_int_equal(file_write_private(other, "{}", 2, NULL), STATUS_OK);
    snprintf(other, sizeof other, "%s/secret", folder);
    assert_int_equal(file_write_private(other, "{}", 2, NULL), STATUS_OK);
    snprintf(ports[0], sizeof ports[0], "%u", farm);
    snprintf(ports[1], sizeof ports[1], "%u", foreign);
    how.program = self;
    how.arguments = arguments;
    how.folder = own;
    how.file_bytes = 1 << 20;
    o = run(&how, NULL); /* without the wall it can: the test sees what it looks for */
    assert_int_equal(o.exit_status, 0);
    assert_true(strchr(o.output, 's') && strchr(o.output, 'o') && strchr(o.output, 'p') && strchr(o.output, 'w') &&
                strchr(o.output, 'x') && strchr(o.output, 'c') && strchr(o.output, 'n') && strchr(o.output, 'u') &&
                strchr(o.output, 'd') && strchr(o.output, 't'));
    how.wall_port = farm;
    o = run(&how, NULL);
    assert_int_equal(o.exit_status, 0);
    assert_true(strchr(o.output, 's') && strchr(o.output, 'c'));
    wall_words(kernel, sizeof kernel);
    has = o.output;
    if (strstr(kernel, "files"))
        assert_false(strpbrk(has, "opwx") != NULL);
    if (strstr(kernel, "network"))
        assert_false(strchr(has, 'n') != NULL);
    if (strstr(kernel, "system calls"))
        assert_false(strpbrk(has, "udtm") != NULL);
    for (int i = 0; i < 2; i++)
        close(listeners[i]);
    unlink(other);
    snprintf(other, sizeof other, "%s/scene.gltf", own);
    unlink(other);
    snprintf(other, sizeof other, "%s/made", own);
    unlink(other);
    rmdir(own);
    rmdir(folder);
}

int main(int argc, char **argv)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(plain_paths_are_taken),
        cmocka_unit_test(paths_that_lead_elsewhere_are_refused),
        cmocka_unit_test(options_become_single_words),
        cmocka_unit_test(other_options_are_refused_by_name),
        cmocka_unit_test(options_are_those_of_submit),
        cmocka_unit_test(errors_name_no_folder_of_the_server),
        cmocka_unit_test(missing_files_are_to_be_uploaded),
        cmocka_unit_test(warnings_are_listed),
        cmocka_unit_test(a_program_gives_its_output_and_status),
        cmocka_unit_test(a_program_that_is_not_there_says_so),
        cmocka_unit_test(only_the_secret_is_inherited),
        cmocka_unit_test(limits_are_kept),
        cmocka_unit_test(much_on_standard_error_ends_nothing),
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
        cmocka_unit_test(memory_is_limited),
#endif
        cmocka_unit_test(an_end_is_told_once_after_a_kill),
        cmocka_unit_test(nothing_is_told_after_it_was_abandoned),
        cmocka_unit_test(it_dies_with_the_coordinator),
        cmocka_unit_test(strangers_files_are_read_behind_a_wall),
    };
    int exit_status;

    if (web_child_launch(argc, argv, &exit_status))
        return exit_status;
    if (argc == 5 && strcmp(argv[1], "try-all") == 0)
        return try_all(argv);
    return cmocka_run_group_tests(tests, NULL, NULL);
}
