#include "anigen/io/gltf/export_skin.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

constexpr std::size_t kSetSize = 4;

// The row's weights in single precision with a sum as close to 1 as Khronos' validator demands (2e-7 per influence).
// A row that is close enough stays as it is, so that reading the file back gives the same numbers; otherwise the
// heaviest takes the rounding of the others.
std::vector<float> weights_of_row(const SkinWeights& skin, std::size_t v) {
  const Influence* row = skin.row(v);
  const std::size_t n = skin.row_size(v);
  std::vector<float> weights(n);
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) sum += static_cast<double>(weights[i] = row[i].weight);
  if (std::abs(sum - 1.0) <= 1e-7 * static_cast<double>(n)) return weights;
  double others = 0.0;
  for (std::size_t i = 1; i < n; ++i) {
    weights[i] = static_cast<float>(static_cast<double>(row[i].weight) / sum);
    others += static_cast<double>(weights[i]);
  }
  weights[0] = static_cast<float>(1.0 - others);
  return weights;
}

template <typename Index>
std::vector<Index> joint_set(const SkinWeights& skin, std::size_t set) {
  std::vector<Index> joints(kSetSize * skin.rows(), 0);
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    for (std::size_t k = 0, i = kSetSize * set; k < kSetSize && i < skin.row_size(v); ++k, ++i) {
      joints[kSetSize * v + k] = static_cast<Index>(skin.row(v)[i].joint);
    }
  }
  return joints;
}

std::string numbered(const char* name, std::size_t set) { return name + std::to_string(set); }

}  // namespace

void write_skin_attributes(GltfDocument& document, Json& attributes, const SkinWeights& skin, std::size_t joints,
                           std::size_t influences) {
  const SkinWeights limited = limit_influences(skin, influences);
  const std::size_t sets = std::max<std::size_t>(1, (limited.largest_row() + kSetSize - 1) / kSetSize);
  std::vector<std::vector<float>> weights(sets, std::vector<float>(kSetSize * limited.rows(), 0.0f));
  for (std::size_t v = 0; v < limited.rows(); ++v) {
    const std::vector<float> row = weights_of_row(limited, v);
    for (std::size_t i = 0; i < row.size(); ++i) weights[i / kSetSize][kSetSize * v + i % kSetSize] = row[i];
  }
  constexpr std::size_t kMostJointsInBytes = 255;
  for (std::size_t set = 0; set < sets; ++set) {
    attributes[numbered("JOINTS_", set)] =
        joints <= kMostJointsInBytes
            ? document.add_uint8(joint_set<std::uint8_t>(limited, set), kSetSize, ViewTarget::kVertices)
            : document.add_uint16(joint_set<std::uint16_t>(limited, set), kSetSize, ViewTarget::kVertices);
    attributes[numbered("WEIGHTS_", set)] = document.add_floats(weights[set], kSetSize, ViewTarget::kVertices);
  }
}

void write_skin(GltfDocument& document, const Skeleton& skeleton, const Eigen::Matrix3d& rotation,
                const std::string& file) {
  Eigen::Matrix4d to_world = Eigen::Matrix4d::Identity();
  to_world.topLeftCorner<3, 3>() = rotation.transpose();
  std::vector<float> matrices;
  matrices.reserve(16 * skeleton.size());
  Json joints = Json::array();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    Eigen::Matrix4f inverse = (skeleton.bind[j].inverse() * to_world).cast<float>();
    inverse.row(3) << 0.0f, 0.0f, 0.0f, 1.0f;
    if (!inverse.allFinite()) {
      throw InputError(file, "", "inverse bind matrix of joint " + std::to_string(j) + " exceeds single precision");
    }
    matrices.insert(matrices.end(), inverse.data(), inverse.data() + 16);  // column-major, as in glTF
    joints.push_back(j);
  }
  document.json["skins"] = Json::array({{{"inverseBindMatrices", document.add_floats(matrices, 16, ViewTarget::kNone)},
                                         {"skeleton", 0},
                                         {"joints", std::move(joints)}}});
}

}  // namespace anigen::io
