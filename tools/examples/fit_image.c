// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Fits 200 Gaussians to one image in memory with its own optimiser: the library renders and
// differentiates, this program implements the loss, Adam and the learning rates.
//
//     fit_image [OUT.ppm [OUT.ply]]
//
// Prints the PSNR every 100 iterations. Exit status 1 when it ends below 35 dB.

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "sparegs/sparegs.h"

enum {
    WIDTH = 128,
    HEIGHT = 80,
    PIXELS = WIDTH * HEIGHT,
    COLUMNS = 20,
    ROWS = 10,
    COUNT = COLUMNS * ROWS,
    FITTED = SGS_PARAM_SH_REST, // mean, rotation, scale, opacity and a colour without directions
    ITERATIONS = 600
};
static const float background[3] = {0.1f, 0.1f, 0.15f};
static const double plane_distance = 2.0; // of the means from the camera, scene units

// Fitted parameters, one row per primitive, and the state of Adam.
typedef struct fit {
    float params[COUNT][FITTED], gradient[COUNT][FITTED];
    double m[COUNT][FITTED], v[COUNT][FITTED];
} fit;

static int fail(const char *what)
{
    fprintf(stderr, "fit_image: %s: %s\n", what, sgs_last_error());
    return EXIT_FAILURE;
}

// The image: a sky, a sun, and a hill with stripes.
static void paint(float picture[3][PIXELS])
{
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x) {
            const double u = (x + 0.5) / WIDTH, v = (y + 0.5) / HEIGHT;
            const double sun =
                exp(-900.0 * ((u - 0.7) * (u - 0.7) + 0.4 * (v - 0.25) * (v - 0.25)));
            const double hill = 1.0 / (1.0 + exp(-150.0 * (v - 0.62 + 0.18 * sin(5.0 * u))));
            const double wave = 0.5 + 0.5 * sin(40.0 * u + 70.0 * v * v);
            const double sky[3] = {0.35 + 0.3 * v, 0.5 + 0.25 * v, 0.85 - 0.15 * v};
            const double land[3] = {0.15 + 0.25 * wave, 0.3 + 0.25 * wave, 0.2 + 0.2 * v};
            for (int c = 0; c < 3; ++c) {
                const double light = c == 2 ? 0.15 : 0.35;
                picture[c][y * WIDTH + x] =
                    (float)((1.0 - hill) * (sky[c] + light * sun) + hill * land[c]);
            }
        }
}

// A grid of discs in the image plane with the colours of the image.
static void start(fit *f, const sgs_camera *camera, float picture[3][PIXELS])
{
    for (int i = 0; i < COUNT; ++i) {
        float *p = f->params[i];
        const double pixel[2] = {(i % COLUMNS + 0.5) * WIDTH / COLUMNS,
                                 (i / COLUMNS + 0.5) * HEIGHT / ROWS};
        double direction[3];
        sgs_camera_unproject(camera, pixel, direction);
        const int at = (int)pixel[1] * WIDTH + (int)pixel[0];
        for (int k = 0; k < 3; ++k) {
            p[SGS_PARAM_MEAN + k] = (float)(direction[k] / direction[2] * plane_distance);
            p[SGS_PARAM_SCALE + k] = (float)log(0.06);
            p[SGS_PARAM_SH_DC + k] = (picture[k][at] - 0.5f) / 0.28209479f;
        }
        p[SGS_PARAM_MEAN + 2] +=
            0.001f * (float)(i % 7); // different depths, so that the order is defined
        p[SGS_PARAM_ROTATION] = 1.0f;
        p[SGS_PARAM_OPACITY] = 1.0f;
    }
}

static sgs_status put_params(const fit *f, sgs_gaussians *model)
{
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; k < FITTED && !status; ++k)
        status = sgs_gaussians_write(model, k, 0, COUNT, &f->params[0][k], sizeof f->params[0]);
    return status;
}

static sgs_status get_gradients(fit *f, const sgs_gaussians *d_model)
{
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; k < FITTED && !status; ++k)
        status =
            sgs_gaussians_read(d_model, k, 0, COUNT, &f->gradient[0][k], sizeof f->gradient[0]);
    return status;
}

// Mean squared error over the background, and its gradient. The image is C + T b, so dL/dC is dL/d
// image and dL/dT its product with b.
static double evaluate(const sgs_frame *frame, float picture[3][PIXELS], sgs_frame *d_frame)
{
    double sum = 0.0;
    for (int i = 0; i < PIXELS; ++i) {
        d_frame->transmittance[i] = 0.0f;
        for (int c = 0; c < 3; ++c) {
            const float image = frame->color[c][i] + frame->transmittance[i] * background[c];
            const float error = image - picture[c][i];
            sum += (double)error * (double)error;
            d_frame->color[c][i] = 2.0f * error / (3 * PIXELS);
            d_frame->transmittance[i] += d_frame->color[c][i] * background[c];
        }
    }
    return sum / (3.0 * PIXELS);
}

static double learning_rate(int param, int iteration)
{
    const double decay = pow(0.05, (double)iteration / ITERATIONS);
    const double rate = param < SGS_PARAM_ROTATION  ? 0.004
                        : param < SGS_PARAM_SCALE   ? 0.03
                        : param < SGS_PARAM_OPACITY ? 0.03
                        : param < SGS_PARAM_SH_DC   ? 0.05
                                                    : 0.03;
    return rate * decay;
}

static void adam(fit *f, int iteration)
{
    const double beta1 = 0.9, beta2 = 0.99;
    const double correct1 = 1.0 - pow(beta1, iteration), correct2 = 1.0 - pow(beta2, iteration);
    for (int i = 0; i < COUNT; ++i)
        for (int k = 0; k < FITTED; ++k) {
            const double g = (double)f->gradient[i][k];
            f->m[i][k] = beta1 * f->m[i][k] + (1.0 - beta1) * g;
            f->v[i][k] = beta2 * f->v[i][k] + (1.0 - beta2) * g * g;
            const double step = f->m[i][k] / correct1 / (sqrt(f->v[i][k] / correct2) + 1e-12);
            f->params[i][k] -= (float)(learning_rate(k, iteration) * step);
        }
}

static int write_ppm(const char *path, const sgs_frame *frame)
{
    FILE *stream = fopen(path, "wb");
    if (!stream) {
        perror(path);
        return EXIT_FAILURE;
    }
    fprintf(stream, "P6\n%d %d\n255\n", WIDTH, HEIGHT);
    for (int i = 0; i < PIXELS; ++i)
        for (int c = 0; c < 3; ++c) {
            const float image = frame->color[c][i] + frame->transmittance[i] * background[c];
            fputc((int)(255.0f * fminf(fmaxf(image, 0.0f), 1.0f) + 0.5f), stream);
        }
    return fclose(stream) ? EXIT_FAILURE : EXIT_SUCCESS;
}

// One rendering of `model`, its loss and, if d_model is not NULL, the gradients.
static sgs_status step(sgs_renderer *renderer, const sgs_camera *camera, sgs_frame *frame,
                       sgs_frame *d_frame, float picture[3][PIXELS], sgs_gaussians *d_model,
                       double *psnr)
{
    const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    sgs_render_options options = sgs_render_options_default();
    options.sh_degree = 0;
    options.differentiable = d_model != NULL;
    sgs_status status = sgs_renderer_refit(renderer); // the parameters have changed
    if (!status)
        status = sgs_renderer_render(renderer, camera, &pose, &options, frame);
    if (status)
        return status;
    *psnr = -10.0 * log10(evaluate(frame, picture, d_frame));
    return d_model ? sgs_renderer_backward(renderer, d_frame, d_model) : SGS_STATUS_OK;
}

int main(int argc, char **argv)
{
    static fit f;
    static float picture[3][PIXELS];
    const sgs_camera camera = {
        SGS_CAMERA_PINHOLE, WIDTH, HEIGHT, {WIDTH, WIDTH, WIDTH / 2.0, HEIGHT / 2.0}};
    sgs_gaussians *model = NULL, *d_model = NULL;
    sgs_renderer *renderer = NULL;
    sgs_frame frame, d_frame;
    if (sgs_gaussians_create(COUNT, &model) || sgs_gaussians_resize(model, COUNT) ||
        sgs_gaussians_create(COUNT, &d_model) || sgs_gaussians_resize(d_model, COUNT) ||
        sgs_frame_create_with(WIDTH, HEIGHT, 0, &frame) ||
        sgs_frame_create_with(WIDTH, HEIGHT, 0, &d_frame) || sgs_renderer_create(model, &renderer))
        return fail("start");
    model->sh_degree = 0;
    paint(picture);
    start(&f, &camera, picture);

    double psnr = 0.0;
    for (int i = 1; i <= ITERATIONS; ++i) {
        if (put_params(&f, model) ||
            step(renderer, &camera, &frame, &d_frame, picture, d_model, &psnr) ||
            get_gradients(&f, d_model))
            return fail("iteration");
        if (i % 100 == 1)
            printf("iteration %d: PSNR %.2f dB\n", i, psnr);
        adam(&f, i);
    }
    if (put_params(&f, model) || step(renderer, &camera, &frame, &d_frame, picture, NULL, &psnr))
        return fail("last rendering");
    printf("%d Gaussians after %d iterations: PSNR %.2f dB\n", COUNT, ITERATIONS, psnr);

    int result = psnr >= 35.0 ? EXIT_SUCCESS : EXIT_FAILURE;
    if (argc > 1 && write_ppm(argv[1], &frame))
        result = EXIT_FAILURE;
    if (argc > 2 && sgs_ply_write(argv[2], model))
        result = fail("saving");
    sgs_renderer_destroy(renderer);
    sgs_frame_free(&frame);
    sgs_frame_free(&d_frame);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(d_model);
    return result;
}
