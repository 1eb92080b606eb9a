#include "client/study/study_files.h"

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "client/link/child.h"
#include "client/study/page/study_page.h"
#include "client/study/page/study_plot.h"
#include "client/terminal/must.h"
#include "common/system/file.h"
#include "common/base/number.h"

#define CONVERTER "rsvg-convert"
#define PNG_ZOOM "2"
enum { READ_BYTES = 65536, PNG_BYTES_MAX = 64 << 20 };

/* ---- CSV ----------------------------------------------------------------------------------- */

static void csv_text(struct buffer *out, const char *text)
{
    buffer_puts(out, "\"");
    for (; text && *text; text++)
        buffer_printf(out, *text == '"' ? "\"\"" : "%c", *text);
    buffer_puts(out, "\"");
}

static void csv_number(struct buffer *out, double value)
{
    char text[NUMBER_TEXT_SIZE];

    buffer_printf(out, ",%s", isfinite(value) ? number_text(text, value) : "");
}

static void csv_interval(struct buffer *out, const struct study_interval *v)
{
    csv_number(out, v->value);
    csv_number(out, v->low);
    csv_number(out, v->high);
}

static void csv_points(struct buffer *out, const char *title, const char *name, const study_points *points)
{
    for (size_t i = 0; i < points->count; i++) {
        const struct study_point *p = &points->items[i];

        csv_text(out, title);
        buffer_puts(out, ",");
        csv_text(out, name);
        csv_number(out, p->core_s);
        csv_number(out, p->wall_s);
        csv_number(out, p->samples);
        csv_number(out, p->rays);
        csv_interval(out, &p->codes);
        csv_number(out, p->psnr_db);
        csv_interval(out, &p->rmse);
        buffer_printf(out, ",%d", p->reliable);
        csv_number(out, p->top_share);
        buffer_puts(out, ",");
        csv_text(out, p->reason);
        csv_interval(out, &p->seeds);
        csv_interval(out, &p->relmse);
        csv_interval(out, &p->flip);
        buffer_puts(out, "\r\n");
    }
}

void study_csv(struct buffer *out, const struct study *s)
{
    buffer_puts(out, "question,choice,core_s,wall_s,samples,rays,codes,codes_low,codes_high,psnr_db,"
                     "rmse,rmse_low,rmse_high,reliable,top_share,reason,seeds,seeds_low,seeds_high,"
                     "relmse,relmse_low,relmse_high,flip,flip_low,flip_high\r\n");
    csv_points(out, "", "main", &s->points);
    for (size_t i = 0; i < s->questions.count; i++)
        for (size_t k = 0; k < s->questions.items[i].choices.count; k++)
            csv_points(out, s->questions.items[i].title, s->questions.items[i].choices.items[k].name,
                       &s->questions.items[i].choices.items[k].points);
}

/* ---- PNG ----------------------------------------------------------------------------------- */

/* Read the pipe to its end; ERR_IO, ERR_LIMIT. */
static status read_all(int fd, struct buffer *out, struct error *err)
{
    char block[READ_BYTES];
    ssize_t got;

    while ((got = read(fd, block, sizeof block)) != 0) {
        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            return error_set(err, STATUS_ERR_IO, CONVERTER ": %s", strerror(errno));
        if (out->size + (size_t)got > PNG_BYTES_MAX)
            return error_set(err, STATUS_ERR_LIMIT, CONVERTER " writes more than %d bytes", (int)PNG_BYTES_MAX);
        buffer_append(out, block, (size_t)got);
    }
    must_hold(out);
    return STATUS_OK;
}

static status run_converter(char *program, char *svg, struct buffer *png, struct error *err)
{
    char zoom[] = "--zoom=" PNG_ZOOM, format[] = "--format=png", end[] = "--";
    char *argv[] = {program, zoom, format, end, svg, NULL};
    struct child child;
    int ends[2];
    status result;

    if (pipe2(ends, O_CLOEXEC) != 0)
        return error_set(err, STATUS_ERR_IO, "no pipe to " CONVERTER ": %s", strerror(errno));
    result = child_start(&child, CONVERTER, argv, NULL, ends[1], SIGKILL, err);
    close(ends[1]);
    if (result == STATUS_OK) {
        result = read_all(ends[0], png, err);
        close(ends[0]);
        ends[0] = -1;
        while (waitpid(child.pid, &child.wait_status, 0) < 0 && errno == EINTR) {
        }
        if (result == STATUS_OK && child.wait_status != 0) {
            char how[128];
            child_describe_end(&child, how, sizeof how);
            result = error_set(err, STATUS_ERR_INCOMPLETE, "%s: %s %s, so there is no PNG of it", svg, CONVERTER, how);
        }
    }
    if (ends[0] >= 0)
        close(ends[0]);
    return result;
}

/* Convert an SVG file to a PNG beside it. */
static status convert(const char *program, struct buffer *path, struct error *err)
{
    struct buffer png = BUFFER_INIT, program_path = BUFFER_INIT;
    status result;

    buffer_puts(&program_path, program);
    must_hold(&program_path);
    result = run_converter((char *)program_path.data, (char *)path->data, &png, err);
    if (result == STATUS_OK) {
        memcpy(path->data + path->size - 3, "png", 3);
        result = file_write_atomic(buffer_text(path), png.data, png.size, err);
    }
    buffer_release(&program_path);
    buffer_release(&png);
    return result;
}

/* ---- all files ----------------------------------------------------------------------------- */

/* Write `text` to STEM + `end`, unless `made`, the status of making them, is a failure. */
static status put_file(const char *page, const char *end, const struct buffer *text, status made, struct buffer *path,
                       struct error *err)
{
    if (made != STATUS_OK)
        return made;
    buffer_clear(path);
    buffer_printf(path, "%.*s%s", (int)(strlen(page) - strlen(".html")), page, end);
    must_hold(path);
    must_hold(text);
    return file_write_atomic(buffer_text(path), text->data, text->size, err);
}

static status write_plots(const struct study *s, const char *page, struct error *err)
{
    struct buffer text = BUFFER_INIT, path = BUFFER_INIT, program = BUFFER_INIT;
    struct error missing = {0};
    status result = STATUS_OK;

    if (child_find_program(CONVERTER, &program, NULL) != STATUS_OK)
        (void)error_set(&missing, STATUS_ERR_INCOMPLETE,
                        "the plots are there as SVG but not as PNG: the program " CONVERTER
                        " is not in PATH (Debian: apt-get install librsvg2-bin)");
    for (int f = 0; f < STUDY_FIGURES && result == STATUS_OK; f++) {
        struct buffer end = BUFFER_INIT;

        if (!study_figure_has(s, (enum study_figure)f))
            continue;
        buffer_clear(&text);
        buffer_printf(&end, "-%s.svg", study_figure_names[f]);
        study_figure_file(&text, s, (enum study_figure)f);
        result = put_file(page, buffer_text(&end), &text, STATUS_OK, &path, err);
        if (result == STATUS_OK && program.size && !missing.code) {
            result = convert(buffer_text(&program), &path, err);
            if (result == STATUS_ERR_INCOMPLETE) {
                missing = *err;
                result = STATUS_OK;
            }
        }
        buffer_release(&end);
    }
    if (result == STATUS_OK && missing.code)
        result = error_set(err, missing.code, "%s", missing.text);
    buffer_release(&program);
    buffer_release(&path);
    buffer_release(&text);
    return result;
}

status study_files_write(const struct study *s, const char *page, int page_only, struct error *err)
{
    struct buffer text = BUFFER_INIT, path = BUFFER_INIT;
    status result = put_file(page, ".html", &text, study_page(&text, s, err), &path, err);

    if (result == STATUS_OK && !page_only) {
        buffer_clear(&text);
        study_csv(&text, s);
        result = put_file(page, ".csv", &text, STATUS_OK, &path, err);
    }
    if (result == STATUS_OK && !page_only) {
        buffer_clear(&text);
        result = put_file(page, ".json", &text, study_write(&text, s, err), &path, err);
    }
    if (result == STATUS_OK && !page_only)
        result = write_plots(s, page, err);
    buffer_release(&path);
    buffer_release(&text);
    return result;
}
