// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The cells of the blocks fill space, so the face nearest to a point is one of its own cell's. The
// position of a pixel is the mean over the hits of its ray, weighted as their colours; pixels that
// are more transparent than opaque have none and belong to the rest.

#include "blocks/seam_report.h"

#include <math.h>
#include <stdio.h>

#include "cli/json_output.h"
#include "cli/progress.h"
#include "processes/interrupt.h"

static double squared_error(const view_images *images, size_t plane, size_t at)
{
    double sum = 0;
    for (size_t c = 0; c < 3; ++c) {
        const int error =
            (int)images->drawn.pixels[c * plane + at] - (int)images->photo.pixels[c * plane + at];
        sum += error * error;
    }
    return sum;
}

static void add_pixels(const evaluator *evaluation, const block_plan *plan, const sgs_frame *frame,
                       const view_images images[2], const uint16_t *valid_mask, seam_report *report)
{
    const sgs_image8 *photo = &images[0].photo;
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    const float near_face = (float)(SEAM_WIDTH * evaluation->scene->extent);
    for (int y = 0; y < photo->height; ++y)
        for (int x = 0; x < photo->width; ++x) {
            const size_t at = (size_t)y * (size_t)photo->width + (size_t)x;
            if (!sgs_mask_is_valid(valid_mask, photo->width, x, y))
                continue;
            const float point[3] = {frame->position[0][at], frame->position[1][at],
                                    frame->position[2][at]};
            const sgs_box *box = &plan->boxes[block_plan_find(plan, point)];
            const bool seam =
                frame->transmittance[at] < 0.5F && sgs_box_face_distance(box, point) <= near_face;
            report->squares[seam] += squared_error(&images[0], plane, at);
            if (report->has_reference)
                report->reference[seam] += squared_error(&images[1], plane, at);
            report->pixels[seam] += 3;
        }
}

static bool add_view(evaluator *evaluation, evaluator *reference, const block_plan *plan, size_t v,
                     seam_report *report)
{
    const sgs_view *view = &evaluation->scene->views[v];
    view_score score;
    view_images images[2] = {0};
    sgs_frame frame = {0};
    const sgs_photo *photo;
    if (!evaluate_view(evaluation, view, &score, &images[0]) ||
        (reference && !evaluate_view(reference, view, &score, &images[1]))) {
        view_images_free(&images[0]);
        return false;
    }
    const bool done =
        !sgs_scene_photo(evaluation->scene, v, &photo) &&
        !sgs_frame_create_with(view->camera.width, view->camera.height, SGS_AOV_POSITION, &frame) &&
        !sgs_renderer_render(evaluation->renderer, &view->camera, &view->pose, &evaluation->render,
                             &frame);
    if (done)
        add_pixels(evaluation, plan, &frame, images, photo->valid_mask, report);
    else
        fail_library();
    report->images += done;
    sgs_frame_free(&frame);
    view_images_free(&images[0]);
    view_images_free(&images[1]);
    return done;
}

bool seam_report_make(evaluator *evaluation, evaluator *reference, const block_plan *plan,
                      size_t most, seam_report *report)
{
    const sgs_scene *scene = evaluation->scene;
    const bool holds_out = scene_split_count(scene, SGS_SPLIT_TEST) > 0;
    *report = (seam_report){.split = holds_out ? SGS_SPLIT_TEST : SGS_SPLIT_TRAIN,
                            .has_reference = reference != NULL};
    const size_t total = scene_split_count(scene, report->split);
    const size_t wanted = most < total ? most : total;
    size_t k = 0;
    progress_work_start();
    for (size_t v = 0; v < scene->view_count && !interrupt_signal(); ++v) {
        if (!view_in_split(&scene->views[v], report->split))
            continue;
        // Image k of `total` is one of `wanted` at equal intervals.
        const bool chosen = k * wanted / total != (k + 1) * wanted / total;
        ++k;
        if (!chosen)
            continue;
        progress_work("comparing seams", report->images, wanted);
        if (!add_view(evaluation, reference, plan, v, report)) {
            progress_end();
            return false;
        }
    }
    progress_end();
    return true;
}

// PSNR of the pixels at the seams or of the others; NaN without pixels.
static double psnr(const double squares[2], const seam_report *report, bool seam)
{
    return 10 * log10(255.0 * 255.0 / (squares[seam] / report->pixels[seam]));
}

static double difference(const double squares[2], const seam_report *report)
{
    return psnr(squares, report, false) - psnr(squares, report, true);
}

// Loss of PSNR at the seams in dB: of the rest minus of the seams, in excess of the same difference
// of the reference. NaN without pixels.
static double loss_of(const seam_report *report)
{
    return difference(report->squares, report) -
           (report->has_reference ? difference(report->reference, report) : 0);
}

static double pixel_share(const seam_report *report)
{
    return report->pixels[1] / (report->pixels[0] + report->pixels[1]);
}

json_t *seam_report_json(const seam_report *report)
{
    const bool refers = report->has_reference;
    json_t *root = json_object();
    json_object_set_new(root, "images", json_integer((json_int_t)report->images));
    json_object_set_new(root, "split",
                        json_string(report->split == SGS_SPLIT_TEST ? "test" : "train"));
    json_object_set_new(root, "width", json_number(SEAM_WIDTH));
    json_object_set_new(root, "pixel_share", json_number(pixel_share(report)));
    json_object_set_new(root, "psnr_seam", json_number(psnr(report->squares, report, true)));
    json_object_set_new(root, "psnr_rest", json_number(psnr(report->squares, report, false)));
    json_object_set_new(root, "reference_psnr_seam",
                        json_number(refers ? psnr(report->reference, report, true) : NAN));
    json_object_set_new(root, "reference_psnr_rest",
                        json_number(refers ? psnr(report->reference, report, false) : NAN));
    json_object_set_new(root, "loss", json_number(loss_of(report)));
    return root;
}

void seam_report_print(const seam_report *report, bool quiet)
{
    const double loss = loss_of(report);
    if (!quiet && !(report->pixels[1] > 0)) {
        printf("seams: no pixel of %zu images is within %g extents of a face\n", report->images,
               SEAM_WIDTH);
    } else if (!quiet) {
        printf("seams: PSNR %.2f dB within %g extents of a face (%.1f %% of the pixels of %zu "
               "images), %.2f dB elsewhere",
               psnr(report->squares, report, true), SEAM_WIDTH, 100 * pixel_share(report),
               report->images, psnr(report->squares, report, false));
        if (report->has_reference)
            printf("; reference %.2f and %.2f dB", psnr(report->reference, report, true),
                   psnr(report->reference, report, false));
        printf("; loss at the seams %.2f dB\n", loss);
    }
    if (loss >= SEAM_LIMIT)
        print_warning("loss of %.2f dB at the seams between the blocks; train the blocks longer, "
                      "start from a better coarse model, or use fewer blocks",
                      loss);
}
