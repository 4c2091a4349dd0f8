// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The rules of UsdGeomXformable: xformOpOrder names the operations of a prim, the last of which
// acts first. "!invert!" precedes the name of an inverse, and "!resetXformStack!" removes what
// precedes it and the transforms of the prims above. rotateXYZ turns about x first. Angles are in
// degrees, quaternions w x y z.

#include "usd/usd_transform.h"

#include <math.h>
#include <string.h>

#include "base/core.h"

#define DEGREE (3.14159265358979323846 / 180.0)

static const char invert[] = "!invert!", reset[] = "!resetXformStack!";

// ---- Matrices ----

void sgsi_usd_identity(double matrix[4][4])
{
    for (int i = 0; i < 4; ++i)
        for (int j = 0; j < 4; ++j)
            matrix[i][j] = i == j;
}

void sgsi_usd_multiply(double left[4][4], const double right[4][4])
{
    for (int i = 0; i < 4; ++i) {
        double row[4];
        memcpy(row, left[i], sizeof row);
        for (int j = 0; j < 4; ++j)
            left[i][j] = row[0] * right[0][j] + row[1] * right[1][j] + row[2] * right[2][j] +
                         row[3] * right[3][j];
    }
}

// By Gauss-Jordan elimination; not finite if the matrix is singular.
static void invert_matrix(double matrix[4][4])
{
    double result[4][4];
    sgsi_usd_identity(result);
    for (int column = 0; column < 4; ++column) {
        int pivot = column;
        for (int row = column + 1; row < 4; ++row)
            if (fabs(matrix[row][column]) > fabs(matrix[pivot][column]))
                pivot = row;
        const double inverse = 1.0 / matrix[pivot][column];
        for (int k = 0; k < 4; ++k) {
            const double a = matrix[column][k], b = result[column][k];
            matrix[column][k] = matrix[pivot][k] * inverse;
            result[column][k] = result[pivot][k] * inverse;
            if (pivot != column) {
                matrix[pivot][k] = a;
                result[pivot][k] = b;
            }
        }
        for (int row = 0; row < 4; ++row) {
            const double factor = matrix[row][column];
            for (int k = 0; row != column && k < 4; ++k) {
                matrix[row][k] -= factor * matrix[column][k];
                result[row][k] -= factor * result[column][k];
            }
        }
    }
    memcpy(matrix, result, sizeof result);
}

static void rotate_about(int axis, double degrees, double matrix[4][4])
{
    const int a = (axis + 1) % 3, b = (axis + 2) % 3; // a quarter turn moves a to b
    const double quarters = degrees / 90.0;
    double sine = sin(degrees * DEGREE), cosine = cos(degrees * DEGREE), turn[4][4];
    if (quarters == rint(quarters)) { // exactly
        sine = rint(sine);
        cosine = rint(cosine);
    }
    sgsi_usd_identity(turn);
    turn[a][a] = cosine;
    turn[a][b] = sine;
    turn[b][a] = -sine;
    turn[b][b] = cosine;
    sgsi_usd_multiply(matrix, turn);
}

static void orient(const double q[4], double matrix[4][4])
{
    const double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (norm == 0.0)
        return;
    const double unit[4] = {q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm};
    double rotation[3][3];
    sgsi_rotation_matrix(unit, rotation);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            matrix[i][j] = rotation[j][i];
}

void sgsi_usd_turn_y_up(double matrix[4][4])
{
    static const double from_z_up[4][4] = {{1, 0, 0, 0}, {0, 0, -1, 0}, {0, 1, 0, 0}, {0, 0, 0, 1}};
    sgsi_usd_multiply(matrix, from_z_up);
}

bool sgsi_usd_affine(const double matrix[4][4], sgsi_affine *affine)
{
    double columns[3][3];
    bool valid = fabs(matrix[3][3] - 1.0) < 1e-6;
    for (int i = 0; i < 3; ++i) {
        valid = valid && fabs(matrix[i][3]) < 1e-6;
        for (int j = 0; j < 3; ++j)
            columns[j][i] = matrix[i][j];
    }
    return valid && sgsi_affine_make((const double(*)[3])columns, matrix[3], affine);
}

// ---- Operations ----

// Number of values of an operation; 0 if its type is unknown.
static int value_count(const char *type, size_t length)
{
    static const struct {
        const char *type;
        int count;
    } types[] = {{"transform", 16}, {"translate", 3}, {"translateX", 1}, {"translateY", 1},
                 {"translateZ", 1}, {"scale", 3},     {"scaleX", 1},     {"scaleY", 1},
                 {"scaleZ", 1},     {"rotateX", 1},   {"rotateY", 1},    {"rotateZ", 1},
                 {"rotateXYZ", 3},  {"rotateXZY", 3}, {"rotateYXZ", 3},  {"rotateYZX", 3},
                 {"rotateZXY", 3},  {"rotateZYX", 3}, {"orient", 4}};
    for (size_t k = 0; k < sizeof types / sizeof *types; ++k)
        if (strlen(types[k].type) == length && !strncmp(types[k].type, type, length))
            return types[k].count;
    return 0;
}

// The matrix of an operation, whose number of values is right. `type` may have a suffix.
static void operation_matrix(const char *type, const double *values, double matrix[4][4])
{
    sgsi_usd_identity(matrix);
    if (!strncmp(type, "transform", 9)) {
        memcpy(matrix, values, 16 * sizeof *values);
    } else if (!strncmp(type, "orient", 6)) {
        orient(values, matrix);
    } else if (!strncmp(type, "rotate", 6)) {
        const char *axes = type + 6;
        for (int k = 0; axes[k] >= 'X' && axes[k] <= 'Z'; ++k)
            rotate_about(axes[k] - 'X',
                         values[axes[1] >= 'X' && axes[1] <= 'Z' ? axes[k] - 'X' : 0], matrix);
    } else {
        const bool scales = !strncmp(type, "scale", 5);
        const char axis = type[scales ? 5 : 9];
        for (int k = 0; k < 3; ++k)
            if (axis < 'X' || axis > 'Z' || axis - 'X' == k)
                *(scales ? &matrix[k][k] : &matrix[3][k]) =
                    values[axis < 'X' || axis > 'Z' ? k : 0];
    }
}

void sgsi_usd_transform_begin(sgsi_usd_transform *transform, bool keeps)
{
    *transform = (sgsi_usd_transform){.keeps = keeps};
}

void sgsi_usd_transform_free(sgsi_usd_transform *transform)
{
    for (int k = 0; k < transform->count; ++k)
        sgsi_usd_value_free(&transform->operations[k].value);
    sgsi_free(transform->operations);
    transform->operations = NULL;
    transform->count = 0;
}

// Index of the operation, which is added if it is new; -1 if there are too many. False without
// memory.
static bool find_operation(sgsi_usd_transform *transform, const char *name, size_t length,
                           int *index)
{
    const int count = transform->count;
    for (*index = 0; *index < count; ++*index)
        if (strlen(transform->operations[*index].name) == length &&
            !strncmp(transform->operations[*index].name, name, length))
            return true;
    if (count == SGSI_USD_OPERATIONS) {
        transform->crowded = true;
        *index = -1;
        return true;
    }
    if (!sgsi_grow((void **)&transform->operations, (size_t)count, (size_t)count + 1,
                   sizeof *transform->operations))
        return false;
    sgsi_usd_operation *made = &transform->operations[transform->count++];
    *made = (sgsi_usd_operation){0};
    memcpy(made->name, name, length);
    return true;
}

bool sgsi_usd_transform_set(sgsi_usd_transform *transform, const char *name, sgsi_usd_text text)
{
    const size_t length = strcspn(name, ".");
    int index;
    if (!find_operation(transform, name, length, &index))
        return false;
    return index < 0 || sgsi_usd_value_set(&transform->operations[index].value, name + length, text,
                                           transform->keeps);
}

// One entry of xformOpOrder. False without memory.
static bool list_operation(sgsi_usd_transform *transform, const char *name, size_t length)
{
    if (length == sizeof reset - 1 && !strncmp(name, reset, length)) {
        transform->resets = true;
        transform->listed = 0;
        return true;
    }
    const bool inverse = length > sizeof invert - 1 && !strncmp(name, invert, sizeof invert - 1);
    name += inverse ? sizeof invert - 1 : 0;
    length -= inverse ? sizeof invert - 1 : 0;
    int index = -1;
    if (transform->listed == SGSI_USD_OPERATIONS)
        transform->crowded = true;
    else if (!find_operation(transform, name, length < SGSI_USD_NAME ? length : SGSI_USD_NAME,
                             &index))
        return false;
    if (index < 0)
        return true;
    transform->order[transform->listed].operation = index;
    transform->order[transform->listed++].inverse = inverse;
    return true;
}

bool sgsi_usd_transform_order(sgsi_usd_transform *transform, sgsi_usd_text text)
{
    char word[SGSI_USD_NAME + 1];
    transform->listed = 0;
    transform->resets = false;
    if (!sgsi_usd_accept(&text, "["))
        return true;
    while (!transform->crowded && sgsi_usd_token(&text, word)) {
        if (*word == '"' || *word == '\'') {
            if (!list_operation(transform, text.string, text.string_length))
                return false;
        } else if (*word != ',') {
            break;
        }
    }
    return true;
}

// `time` NULL: without time samples.
static sgsi_usd_fault evaluate(const sgsi_usd_transform *transform, const double *time,
                               double matrix[4][4], bool *between)
{
    sgsi_usd_identity(matrix);
    for (int k = transform->listed - 1; k >= 0; --k) {
        const sgsi_usd_operation *operation = &transform->operations[transform->order[k].operation];
        const sgsi_usd_value *value = &operation->value;
        const char *type = operation->name + sizeof "xformOp:" - 1;
        double numbers[SGSI_USD_NUMBERS], factor[4][4];
        bool mixed;
        if (time ? value->has_spline && !value->sample_count
                 : value->has_spline || value->has_samples)
            return SGSI_USD_ANIMATED;
        const sgsi_usd_blend blend = strncmp(type, "orient", 6) ? SGSI_USD_LINEAR : SGSI_USD_SLERP;
        const int count = sgsi_usd_value_at(value, time ? *time : 0.0, blend, numbers, &mixed);
        if (!count)
            continue;
        if (count != value_count(type, strcspn(type, ":")))
            return SGSI_USD_INVALID;
        operation_matrix(type, numbers, factor);
        if (transform->order[k].inverse)
            invert_matrix(factor);
        sgsi_usd_multiply(matrix, factor);
        *between |= mixed && !strncmp(type, "transform", 9);
    }
    return transform->crowded ? SGSI_USD_CROWDED : SGSI_USD_SOUND;
}

sgsi_usd_fault sgsi_usd_transform_matrix(const sgsi_usd_transform *transform, double matrix[4][4])
{
    bool between = false;
    return evaluate(transform, NULL, matrix, &between);
}

sgsi_usd_fault sgsi_usd_transform_at(const sgsi_usd_transform *transform, double time,
                                     double matrix[4][4], bool *between)
{
    return evaluate(transform, &time, matrix, between);
}
