#pragma once

namespace anigen::eval::kernels {

/// What the transport solvers do to a row of costs, thousands of times per pair of skeletons; rows have some tens of
/// values. Compiled for wider vectors too; every form of kernels gives the same bits.

/// distance[j] = min(distance[j], costs[j] - potential[j] - offset), previous[j] = number where that was less.
/// @return the least distance
double relax(const double* costs, const double* potential, double offset, double number, double* distance,
             double* previous, int n);

double least(const double* values, int n);

/// row[k] += lever · step[k]
void add_scaled(double lever, const double* step, double* row, int n);

}  // namespace anigen::eval::kernels
