#include "anigen/eval/metric_table.h"

#include <cmath>
#include <limits>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/metrics/surface.h"

namespace anigen::eval {

const std::vector<MetricInfo>& metric_table() {
  constexpr Better kLow = Better::kLower, kHigh = Better::kHigher;
  static const std::vector<MetricInfo> kTable = {
      {"j2j", "J2J", kLow, "box", "skeleton", true},
      {"j2b", "J2B", kLow, "box", "skeleton", true},
      {"b2b", "B2B", kLow, "box", "skeleton", true},
      {"wasserstein", "W", kLow, "box", "transport", true},
      {"gromov_wasserstein", "GW", kLow, "box", "transport", true},
      {"gw_lower_bound", "GW bound", Better::kNeither, "box", "transport", false},
      {"fused_gromov_wasserstein", "FGW", kLow, "box", "transport", false},
      {"skin_l1", "skin l1", kLow, "sum over joints", "skin", true},
      {"skin_l2", "skin l2", kLow, "norm over joints", "skin", true},
      {"skin_kl", "skin KL", kLow, "nats", "skin", true},
      {"deformation_error", "deform", kLow, "box", "skin", true},
      {"skin_precision", "skin prec", kHigh, "1", "skin", false},
      {"skin_recall", "skin rec", kHigh, "1", "skin", false},
      {"skin_ce", "skin CE", kLow, "nats", "skin", false},
      {"skin_cos", "skin cos", kHigh, "1", "skin", false},
      {"skin_mae", "skin MAE", kLow, "mean over joints", "skin", false},
      {"motion_distance", "motion", kLow, "box", "motion", true},
      {"motion_distance_rest", "motion at rest", kLow, "box", "motion", false},
      {"surface_chamfer", "Chamfer", kLow, "box", "surface", true},
      {"fscore", "F 0.05", kHigh, "1", "surface", true},
      {"fscore_001", "F 0.01", kHigh, "1", "surface", false},
      {"normal_consistency", "normals", kHigh, "1", "surface", false},
      {"category", "category", kHigh, "1", "surface", false},
      {"psnr", "PSNR", kHigh, "dB", "image", false},
      {"ssim", "SSIM", kHigh, "1", "image", false},
      {"lpips", "LPIPS", kLow, "1", "image", false},
      {"encoder_distance", "encoder", kLow, "1", "image", false},
      {"rignet.j2j", "RigNet J2J", kLow, "box", "skeleton", false},
      {"rignet.j2b", "RigNet J2B", kLow, "box", "skeleton", false},
      {"rignet.b2b", "RigNet B2B", kLow, "box", "skeleton", false},
      {"rignet.iou", "IoU", kHigh, "1", "skeleton", false},
      {"rignet.precision", "joint prec", kHigh, "1", "skeleton", false},
      {"rignet.recall", "joint rec", kHigh, "1", "skeleton", false},
      {"unirig.j2j", "UniRig J2J", kLow, "box", "skeleton", false},
      {"unirig.j2b", "UniRig J2B", kLow, "box", "skeleton", false},
      {"unirig.b2b", "UniRig B2B", kLow, "box", "skeleton", false},
      {"puppeteer.j2j", "Puppeteer J2J", kLow, "box", "skeleton", false},
      {"puppeteer.j2b", "Puppeteer J2B", kLow, "box", "skeleton", false},
      {"puppeteer.b2b", "Puppeteer B2B", kLow, "box", "skeleton", false},
      {"puppeteer.skin_precision", "Puppeteer skin prec", kHigh, "1", "skin", false},
      {"puppeteer.skin_recall", "Puppeteer skin rec", kHigh, "1", "skin", false},
      {"puppeteer.skin_l1", "Puppeteer skin L1", kLow, "sum over joints", "skin", false},
      {"connectivity_precision", "bone prec", kHigh, "1", "skeleton", false},
      {"connectivity_recall", "bone rec", kHigh, "1", "skeleton", false},
      {"joints", "joints", Better::kNeither, "joints", "skeleton", false},
      {"joint_count_error", "joints off", kLow, "joints", "skeleton", false},
      {"tree_edit_distance", "tree edits", kLow, "edits", "skeleton", false},
      {"anymate_cd", "Anymate CD", kLow, "box of side 2", "anymate", false},
      {"anymate_emd", "Anymate EMD", kLow, "box of side 2", "anymate", false},
      {"anymate_emd_exact", "exact EMD", kLow, "box of side 2", "anymate", false},
      {"anymate_precision", "Anymate prec", kHigh, "1", "anymate", false},
      {"anymate_recall", "Anymate rec", kHigh, "1", "anymate", false},
      {"sound_stretched", "stretched", kLow, "1", "soundness", true},
      {"sound_inverted", "inverted", kLow, "1", "soundness", false},
      {"sound_crossed", "crossed", kLow, "1", "soundness", false},
      {"sound_bleed", "bleed", kLow, "1", "soundness", true},
      {"sound_islands", "islands", kLow, "joints", "soundness", false},
      {"sound_dead_joints", "dead joints", kLow, "joints", "soundness", false},
      {"sound_inside", "joints inside", kHigh, "1", "soundness", true},
      {"sound_gap_mean", "gaps", kLow, "1", "soundness", false},
      {"sound_gap_max", "largest gap", kLow, "1", "soundness", false},
      {"icp_rmse", "ICP", kLow, "box", "run", false},
      {"seconds", "seconds", Better::kNeither, "s", "run", false},
  };
  return kTable;
}

const MetricInfo* find_metric(const std::string& key) {
  for (const MetricInfo& info : metric_table()) {
    if (info.key == key) return &info;
  }
  return nullptr;
}

std::string arrow(Better better) {
  return word_of({{Better::kLower, "↓"}, {Better::kHigher, "↑"}, {Better::kNeither, ""}}, better);
}

std::string column_head(const MetricInfo& metric) {
  const std::string mark = arrow(metric.better);
  return mark.empty() ? metric.label : metric.label + " " + mark;
}

int table_digits(const MetricInfo& metric) {
  return metric.unit == "joints" || metric.unit == "edits" || metric.unit == "dB" ? 2 : 4;
}

namespace {

template <typename T>
std::uint64_t hash_of(const std::vector<T>& values, std::uint64_t seed) {
  const std::uint64_t counted = stable_hash(std::to_string(values.size()), seed);
  if (values.empty()) return counted;
  return stable_hash({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)}, counted);
}

std::uint64_t hash_of(const io::RigClips& clips, std::uint64_t hash) {
  const auto add = [&hash](const double* values, Eigen::Index count) {
    hash = hash_of(std::vector<double>(values, values + count), hash);
  };
  for (std::size_t j = 0; j < clips.skeleton.size(); ++j) {
    add(clips.skeleton.bind[j].data(), 16);
    add(clips.skeleton.rest[j].matrix().eval().data(), 16);
  }
  for (const Animation& animation : clips.animations) {
    hash = stable_hash(animation.name, hash);
    for (const Channel& channel : animation.channels) {
      const std::vector<int> kind = {channel.joint, static_cast<int>(channel.path),
                                     static_cast<int>(channel.interpolation)};
      hash = hash_of(channel.values, hash_of(channel.times, hash_of(kind, hash)));
    }
  }
  return hash;
}

constexpr std::size_t kSamples = 512;

/// Samples of a surface whose bounding box is centred at 0 and has a longest side of 1.
Eigen::Matrix3Xf normalized_samples(const Mesh& mesh, std::uint64_t seed) {
  const metrics::SurfaceSamples samples = metrics::sample_mesh(mesh, kSamples, seed, "category references");
  Eigen::Matrix3Xd points(3, static_cast<Eigen::Index>(kSamples));
  for (std::size_t i = 0; i < kSamples; ++i) points.col(static_cast<Eigen::Index>(i)) = samples.points[i];
  // The box of the vertices in use would follow a stray one; that of the samples is what is compared.
  const Eigen::Vector3d low = points.rowwise().minCoeff(), high = points.rowwise().maxCoeff();
  const double side = (high - low).maxCoeff();
  if (!(side > 0)) throw InputError("", "", "the surface has no extent");
  return ((points.colwise() - (low + high) / 2) / side).cast<float>();
}

/// ½ mean_a d(a, B), given up beyond `most`, where it returns something larger than that.
double half_distance(const Eigen::Matrix3Xf& a, const Eigen::Matrix3Xf& b, double most) {
  const double share = 0.5 / static_cast<double>(a.cols());
  double sum = 0;
  for (Eigen::Index i = 0; i < a.cols() && sum <= most; ++i)
    sum += share * std::sqrt(static_cast<double>((b.colwise() - a.col(i)).colwise().squaredNorm().minCoeff()));
  return sum;
}

}  // namespace

std::uint64_t fingerprint(const io::RiggedShape& shape) {
  std::uint64_t hash = hash_of(shape.mesh.vertices, 1);
  hash = hash_of(shape.mesh.faces, hash);
  hash = hash_of(shape.mesh.normals, hash);  // pictures are shaded by them
  hash = hash_of(shape.mesh.colors, hash);
  hash = hash_of(shape.mesh.uvs, hash);
  hash = hash_of(shape.mesh.face_materials, hash);
  for (const Material& material : shape.materials) {
    const Eigen::Vector4f& c = material.base_color;
    hash = hash_of(std::vector<float>{c.x(), c.y(), c.z(), c.w(), static_cast<float>(material.image)}, hash);
  }
  for (const EncodedImage& image : shape.images) hash = hash_of(image.bytes, hash);
  hash = hash_of(shape.joints.positions, hash);
  hash = hash_of(shape.joints.parents, hash);
  hash = hash_of(shape.skin.offsets, hash);
  for (const Influence& influence : shape.skin.influences) {
    // Field by field: the bytes between fields, if any, are not ours.
    hash = hash * 1099511628211ULL ^ static_cast<std::uint64_t>(influence.joint);
    hash = stable_hash({reinterpret_cast<const char*>(&influence.weight), sizeof influence.weight}, hash);
  }
  return shape.clips == nullptr ? hash : hash_of(*shape.clips, hash);
}

CategoryReferences::CategoryReferences(const io::ShapeSource& source, const std::vector<std::string>& ids,
                                       std::uint64_t seed)
    : seed_(seed) {
  std::vector<Reference> all(ids.size());
  Progress progress("reading categories", ids.size(), "shapes");
  parallel_for(ids.size(), [&](std::size_t i) {
    if (interrupt_requested()) return;
    progress.advance();
    const std::string category = source.category(ids[i]);
    if (category.empty()) return;
    try {
      const io::RiggedShape shape = source.read(ids[i]);
      if (shape.has_surface()) all[i] = {ids[i], category, normalized_samples(shape.mesh, seed)};
    } catch (const InputError& problem) {
      log::warn("{} is no reference of a category: {}", ids[i], problem.what());
    }
  });
  progress.finish();
  throw_if_interrupted();
  for (Reference& reference : all) {
    if (!reference.category.empty()) references_.push_back(std::move(reference));
  }
}

CategoryReferences::Match CategoryReferences::nearest(const Mesh& mesh, const std::string& excluded) const {
  const Eigen::Matrix3Xf points = normalized_samples(mesh, seed_);
  double least = std::numeric_limits<double>::infinity();
  const Reference* nearest = nullptr;
  for (const Reference& reference : references_) {
    if (reference.id == excluded) continue;
    double distance = half_distance(points, reference.points, least);
    if (distance < least) distance += half_distance(reference.points, points, least - distance);
    if (distance >= least) continue;
    least = distance;
    nearest = &reference;
  }
  if (nearest == nullptr) throw InputError("", excluded, "there is no other shape to tell its category by");
  return {nearest->id, nearest->category, least};
}

Json CategoryReferences::describe() const {
  std::uint64_t hash = 0;
  for (const Reference& reference : references_) {
    hash = stable_hash(reference.id + "\n" + reference.category, hash);
    const auto* bytes = reinterpret_cast<const char*>(reference.points.data());
    hash = stable_hash({bytes, static_cast<std::size_t>(reference.points.size()) * sizeof(float)}, hash);
  }
  return {{"references", references_.size()}, {"samples", kSamples}, {"seed", seed_}, {"hash", std::to_string(hash)}};
}

}  // namespace anigen::eval
