#pragma once
#include <Eigen/Core>

#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// What tells joints apart that lie in one place: how far their parents are from each other (a root is its own parent),
/// and a thousandth of the difference in depth. Added to a matching cost with a weight far below any distance that
/// matters, it makes a skeleton with coinciding joints match itself, however they are numbered.
/// @return [n, m] for sound trees of n and m joints, the unit of the positions
Eigen::MatrixXd joint_ties(const io::JointTree& predicted, const io::JointTree& truth);

/// The Wasserstein plan of two joint sets [n, m] (transport/wasserstein.h) with such ties settled: what joints are
/// matched by when weights and poses go from one skeleton to the other. Its cost is within 1e-9 of the optimum in the
/// unit box. @throws InputError as check()
Eigen::MatrixXd matching_plan(const io::JointTree& predicted, const io::JointTree& truth);

}  // namespace anigen::eval
