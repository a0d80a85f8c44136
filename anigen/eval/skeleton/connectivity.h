#pragma once
#include <cstddef>
#include <vector>

#include "anigen/io/rigs/joint_tree.h"

namespace anigen::eval {

/// Which bones of the ground truth a prediction has. A predicted bone is right when both of its joints are matched
/// (see match_joints()) and their true joints are the two ends of one true bone, in either direction: a skeleton with
/// another root keeps its score. Since joints are matched one to one, each true bone is found at most once.
struct ConnectivityScore {
  std::size_t right = 0, predicted_bones = 0, true_bones = 0;
  double precision = 0;  ///< right / predicted bones; without any, 1 when there is no true bone either, else 0
  double recall = 0;     ///< right / true bones; without any, 1 when there is no predicted bone either, else 0
};

/// @param truth_of [predicted], each true joint at most once, -1 for none (JointMatch::truth_of)
/// @throws InputError as check(), or when truth_of does not fit
ConnectivityScore connectivity(const io::JointTree& predicted, const io::JointTree& truth,
                               const std::vector<int>& truth_of);

/// |predicted joints − true joints|.
std::size_t joint_count_error(const io::JointTree& predicted, const io::JointTree& truth);

}  // namespace anigen::eval
