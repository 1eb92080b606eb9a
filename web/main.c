/* azulejo-web: the page and its API, a client of a farm's coordinator. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "common/cli/completion.h"
#include "common/system/file.h"
#include "common/system/log.h"
#include "common/base/memory.h"
#include "common/cli/options.h"
#include "protocol/address.h"
#include "protocol/channel.h"
#include "protocol/listen.h"
#include "web/uploads/child.h"
#include "web/base/confine.h"
#include "web/http/http.h"
#include "web/uploads/import.h"
#include "web/web.h"

#define USAGE "azulejo-web --coordinator HOST:PORT --key FILE [options]"

static int fail(const struct error *err)
{
    if (log_is_json())
        log_error("%s", err->text);
    else
        fprintf(stderr, "azulejo-web: %s\n", err->text);
    return status_exit_code(err->code);
}

/* The key of the role `web`, also out of the farm's own one. */
static status load_key(const char *path, struct farm_key *key, struct error *err)
{
    const char *named = path ? path : getenv("AZULEJO_KEY");
    char words[KEY_WORDS_SIZE];
    struct farm_key file;
    status s;

    if (!named || !named[0])
        return error_set(err, STATUS_ERR_USAGE,
                         "no key: name a file with --key or AZULEJO_KEY (azulejo keygen --role web makes one)");
    s = farm_key_load(&file, named, err);
    if (s == STATUS_OK && file.is_farm)
        s = farm_key_derive(&file, FARM_ROLE_WEB, key, err);
    else if (s == STATUS_OK && file.id.role == FARM_ROLE_WEB)
        *key = file;
    else if (s == STATUS_OK)
        s = error_set(err, STATUS_ERR_REFUSED, "%s: holds the %s; the page needs that of the role web", named,
                      key_identity_words(&file.id, words));
    explicit_bzero(&file, sizeof file);
    return s;
}

static void on_signal(uv_signal_t *handle, int number UNUSED)
{
    struct web *web = handle->loop->data;

    web_stop(web);
}

/* Until a signal, or until it cannot listen. */
static status run(const struct web_options *options, const struct link_peers *farm, int has_parent, struct error *err)
{
    uv_signal_t signals[2];
    struct web *web = NULL;
    uv_loop_t loop;
    status s;

    if (uv_loop_init(&loop) != 0)
        return error_set(err, STATUS_ERR_INTERNAL, "no event loop");
    s = web_new(&web, &loop, options, farm, err);
    if (s == STATUS_OK) {
        const struct confinement confinement = {.uploads = imports_folder(web->imports),
                                                .client = imports_program(web->imports),
                                                .connections = options->connections_max,
                                                .resolves = !address_is_number(farm->host) || listen_looks_up(options->host)};
        loop.data = web;
        for (int i = 0; i < 2; i++) {
            uv_signal_init(&loop, &signals[i]);
            uv_unref((uv_handle_t *)&signals[i]);
        }
        uv_signal_start(&signals[0], on_signal, SIGTERM);
        if (has_parent)
            signal(SIGINT, SIG_IGN); /* a terminal's: the coordinator gets it, too, and says when */
        else
            uv_signal_start(&signals[1], on_signal, SIGINT);
        s = confine(&confinement, err);
        THEN(s, web_start(web, err));
        if (s != STATUS_OK)
            web_stop(web);
        uv_run(&loop, UV_RUN_DEFAULT);
        for (int i = 0; i < 2; i++)
            uv_close((uv_handle_t *)&signals[i], NULL);
        if (s == STATUS_OK && web->why.code != STATUS_OK) {
            s = web->why.code;
            if (err)
                *err = web->why;
        }
    }
    uv_run(&loop, UV_RUN_DEFAULT);
    web_free(web);
    uv_loop_close(&loop);
    return s;
}

int main(int argc, char **argv)
{
    const char *coordinator = NULL, *key_path = NULL, *listen = "127.0.0.1:7421";
    const char *level = "info", *log_format = NULL, *completion = NULL;
    int64_t connections = HTTP_CONNECTIONS_MAX, each = 0, parent = 0;
    struct web_options options = {.folder = "azulejo-web"};
    int help = 0, version = 0, exit_status;
    const struct option table[] = {
        {"coordinator", 'c', OPTION_STRING, &coordinator, "HOST:PORT",
         "the farm's coordinator (AZULEJO_COORDINATOR, 127.0.0.1:7420)", 0, 0, NULL},
        {"key", 'k', OPTION_STRING, &key_path, "FILE",
         "a key of the role web, or the farm's own, of which only that is kept (AZULEJO_KEY)", 0, 0, NULL},
        {"web", 0, OPTION_STRING, &listen, "HOST:PORT",
         "address of the page and its API (127.0.0.1:7421); beyond this machine only over TLS", 0, 0, NULL},
        {"web-name", 0, OPTION_STRING, &options.name, "NAME", "one more name by which browsers reach the page", 0, 0,
         NULL},
        {"web-cert", 0, OPTION_STRING, &options.cert, "FILE",
         "the page's certificate, with its chain, in PEM (one made on first use, in the folder)", 0, 0, NULL},
        {"web-key", 0, OPTION_STRING, &options.key, "FILE", "the certificate's key, in PEM", 0, 0, NULL},
        {"folder", 0, OPTION_STRING, &options.folder, "DIR", "for uploads and the certificate (azulejo-web)", 0, 0, NULL},
        {"client-program", 0, OPTION_STRING, &options.client, "FILE",
         "the program that reads scenes which are uploaded (azulejo, beside this one)", 0, 0, NULL},
        {"connections", 0, OPTION_INT, &connections, "N", "connections of all browsers and programs (256)",
         HTTP_CONNECTIONS_MIN, HTTP_CONNECTIONS_MAX, NULL},
        {"connections-per-address", 0, OPTION_INT, &each, "N",
         "of these that one address may have (three quarters of all)", 1, HTTP_CONNECTIONS_MAX, NULL},
        {"parent", 0, OPTION_INT, &parent, "PID", "end with this process, which is the parent: a coordinator's use", 1,
         INT32_MAX, NULL},
        {"log-level", 0, OPTION_CHOICE, &level, "LEVEL", "what is logged (info)", 0, 0, "error|warn|info|debug"},
        {"log-format", 0, OPTION_CHOICE, &log_format, "FORM",
         "lines of text, or JSON, an object a line (default $AZULEJO_LOG_FORMAT, else text)", 0, 0, "text|json"},
        {"completion", 0, OPTION_CHOICE, &completion, "SHELL", "print a script that completes command lines in a shell",
         0, 0, COMPLETION_SHELLS},
        {"version", 0, OPTION_FLAG, &version, NULL, "print the version", 0, 0, NULL},
        {0},
    };
    char farm_host[ADDRESS_HOST_MAX], host[ADDRESS_HOST_MAX];
    struct link_peers farm = {.host = farm_host};
    struct positionals rest;
    struct error err = {0};
    status s;

    if (web_child_launch(argc, argv, &exit_status))
        return exit_status;
    file_hold_standard();
    log_setup("azulejo-web", LOG_LEVEL_INFO);
    s = options_parse(table, argc, argv, &rest, &help, &err);
    THEN(s, log_set_format(log_format, &err));
    if (s == STATUS_OK && help) {
        options_print_help(USAGE, "Serve the page of a render farm, and its API.", table);
        return 0;
    }
    if (s == STATUS_OK && version) {
        printf("azulejo-web " AZULEJO_VERSION "\n");
        return 0;
    }
    if (s == STATUS_OK && completion) {
        s = completion_print("azulejo-web", completion, USAGE, table, &err);
        return s == STATUS_OK && fflush(stdout) == 0 ? 0 : status_exit_code(STATUS_ERR_IO);
    }
    if (s == STATUS_OK && rest.count > 0)
        s = error_set(&err, STATUS_ERR_USAGE, "unexpected argument '%s'", rest.items[0]);
    if (s == STATUS_OK && !options.cert != !options.key)
        s = error_set(&err, STATUS_ERR_USAGE, "--web-cert and --web-key belong together: name both files");
    if (!coordinator)
        coordinator = getenv("AZULEJO_COORDINATOR");
    THEN(s, address_parse(coordinator && coordinator[0] ? coordinator : "127.0.0.1:7420", "127.0.0.1",
                          PROTOCOL_PORT_DEFAULT, farm_host, sizeof farm_host, &farm.port, &err));
    THEN(s, address_parse(listen, "", 0, host, sizeof host, &options.port, &err));
    if (s == STATUS_OK && parent)
        s = confine_to_parent(parent, &err);
    THEN(s, load_key(key_path, &farm.key, &err));
    if (s == STATUS_OK && parent)
        close(CHILD_SECRET_FD);
    if (s == STATUS_OK && !parent)
        s = file_make_private_folder(options.folder, &err);
    if (s != STATUS_OK)
        return fail(&err);
    log_setup("azulejo-web", (enum log_level)log_level_parse(level));
    signal(SIGPIPE, SIG_IGN);
    options.host = host;
    options.connections_max = (uint32_t)connections;
    options.address_max = (uint32_t)(each ? each : connections - connections / 4);
    s = run(&options, &farm, parent != 0, &err);
    explicit_bzero(&farm.key, sizeof farm.key);
    if (s != STATUS_OK && parent)
        return status_exit_code(s); /* the coordinator says it */
    return s == STATUS_OK ? 0 : fail(&err);
}
