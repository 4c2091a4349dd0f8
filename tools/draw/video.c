// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Sends raw RGB frames to ffmpeg's standard input. H.264 with 4:2:0 chroma, which all players
// support, requires even sizes, so odd sizes are padded, with a note; GIF does not. ffmpeg is
// started by argument vector, never through a shell, and writes a temporary file that is renamed on
// success. Its messages go to a temporary file; the last line is reported on failure.
//
// ffmpeg converts RGB by the matrix of BT.601 and does not record it, but players take unmarked HD
// for BT.709. So the frames are converted to BT.709 and marked, where the format permits it: with
// the matrix and the primaries of BT.709 and the curve of sRGB. The pixel aspect ratio is recorded
// if it is not 1, so that players show anamorphic images in their shape.

#include "draw/video.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "cli/input_file.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "sparegs/image.h"

#define EVEN_SIZE "pad=ceil(iw/2)*2:ceil(ih/2)*2"

struct video {
    sgs_output_file file;
    char *temporary; // ffmpeg writes it; it becomes the temporary file of `file`
    char *output;    // its name for ffmpeg: other names with a colon would be protocols
    int width, height;
    double aspect; // width of a pixel over its height
    pid_t child;
    int pipe;
    bool broken; // ffmpeg does not read any more
    FILE *messages;
    unsigned char *frame; // interleaved RGB
};

bool video_possible(void)
{
    const char *path = getenv("PATH");
    for (const char *at = path ? path : ""; *at; at += *at == ':') {
        const int length = (int)strcspn(at, ":");
        char *program = format_text("%.*s/ffmpeg", length, at);
        const bool found = length && !access(program, X_OK);
        free(program);
        if (found)
            return true;
        at += length;
    }
    fail_run("--video requires ffmpeg, which is not installed; install it (Debian: apt install "
             "ffmpeg), or write frames with --format png");
    return false;
}

// The temporary file of `file` with the extension of its target, from which ffmpeg derives the
// format. NULL after printing the error.
static char *create_temporary(const sgs_output_file *file)
{
    const char *slash = strrchr(file->target, '/'), *dot = strrchr(file->target, '.');
    char *path = format_text("%s%s", file->temporary, dot && dot > slash ? dot : "");
    const int descriptor = open(path, O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
    if (descriptor >= 0) {
        close(descriptor);
        return path;
    }
    fail_run("%s: cannot be written: %s", path, strerror(errno));
    free(path);
    return NULL;
}

// Moves ffmpeg's file to the temporary file of film->file, synchronised like other outputs.
static bool move_temporary(const video *film)
{
    const int descriptor = open(film->temporary, O_RDONLY | O_CLOEXEC);
    const bool moved =
        descriptor >= 0 && !fsync(descriptor) && !rename(film->temporary, film->file.temporary);
    if (!moved)
        fail_run("%s: cannot be written: %s", film->file.path, strerror(errno));
    if (descriptor >= 0)
        close(descriptor);
    return moved;
}

static bool is_gif(const char *path)
{
    return name_has_ending(path, ".gif");
}

// True if ffmpeg records the colour space in files of this format.
static bool records_colors(const char *path)
{
    return name_has_ending(path, ".mp4|.m4v|.mov|.mkv|.webm");
}

static void run_ffmpeg(const video *film, double fps, int input)
{
    char size[32], rate[32], filters[160], shape[48] = "";
    int numerator, denominator;
    snprintf(size, sizeof size, "%dx%d", film->width, film->height);
    // As recorded in EXR files; fps is at least 0.01, and a camera path may have more than 1e6.
    if (sgs_frame_rate(fps, &numerator, &denominator))
        snprintf(rate, sizeof rate, "%d/%d", numerator, denominator);
    else
        snprintf(rate, sizeof rate, "%.6g", fps);
    const bool marked = records_colors(film->file.path);
    if (film->aspect != 1)
        snprintf(shape, sizeof shape, ",setsar=r=%.6g:max=1000", film->aspect);
    snprintf(filters, sizeof filters, "%s%s%s", is_gif(film->file.path) ? "null" : EVEN_SIZE,
             marked ? ",scale=out_color_matrix=bt709:out_range=tv" : "", shape);
    const char *primaries = marked ? "bt709" : "unknown",
               *curve = marked ? "iec61966-2-1" : "unknown";
    // The bytes of x264 depend on its threads, which are by default those of the machine.
    const char *const arguments[] = {"ffmpeg",
                                     "-hide_banner",
                                     "-loglevel",
                                     "error",
                                     "-xerror",
                                     "-y",
                                     "-f",
                                     "rawvideo",
                                     "-pixel_format",
                                     "rgb24",
                                     "-video_size",
                                     size,
                                     "-framerate",
                                     rate,
                                     "-i",
                                     "-",
                                     "-vf",
                                     filters,
                                     "-pix_fmt",
                                     "yuv420p",
                                     "-colorspace",
                                     primaries,
                                     "-color_primaries",
                                     primaries,
                                     "-color_trc",
                                     curve,
                                     "-threads",
                                     "16",
                                     film->output,
                                     NULL};
    setpgid(0, 0); // Ctrl-C stops this program, which then discards the video
    dup2(input, STDIN_FILENO);
    dup2(fileno(film->messages), STDOUT_FILENO);
    dup2(fileno(film->messages), STDERR_FILENO);
    execvp(arguments[0], (char *const *)arguments);
    _exit(127);
}

// Takes back what video_open has done, except the child.
static void free_film(video *film)
{
    sgs_output_file_abort(&film->file);
    if (film->messages)
        fclose(film->messages);
    free(film->frame);
    if (film->temporary)
        unlink(film->temporary);
    free(film->temporary);
    free(film->output);
    free(film);
}

static void note_padding(const char *path, int width, int height)
{
    if ((width % 2 || height % 2) && !is_gif(path))
        print_note(
            "%s: the sizes of videos are even: frames of %d x %d pixels are padded with black "
            "to %d x %d; use an even --size",
            path, width, height, width + width % 2, height + height % 2);
}

video *video_open(const char *path, int width, int height, double aspect, double fps)
{
    int ends[2];
    video *film = calloc(1, sizeof *film);
    if (!film || !open_output(path, &film->file)) {
        free(film);
        return NULL;
    }
    film->temporary = create_temporary(&film->file);
    if (!film->temporary) {
        free_film(film);
        return NULL;
    }
    film->output = format_text("file:%s", film->temporary);
    film->width = width;
    film->height = height;
    film->aspect = aspect;
    film->frame = malloc(3 * (size_t)width * (size_t)height);
    film->messages = tmpfile();
    if (!film->frame || !film->messages || pipe(ends)) {
        fail_run("%s: cannot start ffmpeg: %s", path, strerror(errno));
        free_film(film);
        return NULL;
    }
    signal(SIGPIPE, SIG_IGN); // if ffmpeg ends, the write fails instead
    film->child = fork();
    if (!film->child) {
        close(ends[1]);
        run_ffmpeg(film, fps, ends[0]);
    }
    close(ends[0]);
    film->pipe = ends[1];
    if (film->child > 0) {
        note_padding(path, width, height);
        return film;
    }
    fail_run("%s: cannot start ffmpeg: %s", path, strerror(errno));
    close(ends[1]);
    free_film(film);
    return NULL;
}

// Waits for ffmpeg, which is killed unless the video is complete or it has failed. False after
// printing the error.
static bool finish_child(video *film, bool complete)
{
    int status = 0;
    pid_t ended;
    if (!complete && !film->broken)
        kill(film->child, SIGKILL);
    close(film->pipe);
    while ((ended = waitpid(film->child, &status, 0)) < 0 && errno == EINTR)
        ;
    const int reason = errno;
    const bool exited = ended > 0 && WIFEXITED(status) && WEXITSTATUS(status) == 0;
    if (!film->broken && (exited || !complete))
        return true;
    char line[256], last[256] = "it ended early, without an error message";
    if (ended < 0)
        snprintf(last, sizeof last, "its exit status is unknown: %s", strerror(reason));
    else if (WIFSIGNALED(status))
        snprintf(last, sizeof last, "it was killed by signal %d", WTERMSIG(status));
    rewind(film->messages);
    while (fgets(line, sizeof line, film->messages))
        if (line[strspn(line, " \r\n")])
            snprintf(last, sizeof last, "%.*s", (int)strcspn(line, "\r\n"), line);
    fail_run("%s: ffmpeg failed: %s", film->file.path, last);
    return false;
}

bool video_add(video *film, const sgs_image8 *image)
{
    const size_t pixels = (size_t)film->width * (size_t)film->height;
    for (size_t i = 0; i < pixels; ++i)
        for (size_t c = 0; c < 3; ++c)
            film->frame[3 * i + c] = image->pixels[c * pixels + i];
    for (size_t done = 0; done < 3 * pixels;) {
        const ssize_t step = write(film->pipe, film->frame + done, 3 * pixels - done);
        if (step < 0 && errno == EINTR)
            continue;
        film->broken = step < 0;
        if (film->broken)
            return false; // reported by video_close
        done += (size_t)step;
    }
    return true;
}

bool video_close(video *film, bool complete)
{
    if (!film)
        return true;
    bool done = finish_child(film, complete);
    if (done && complete) {
        char *name = format_text("%s", film->file.path);
        if (!move_temporary(film)) {
            done = false;
        } else if (sgs_output_file_commit(&film->file)) {
            fail_library();
            done = false;
        } else {
            report_file(name);
        }
        free(name);
    }
    free_film(film);
    return done;
}
