#include "anigen/prepare/cleaning.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"

namespace anigen::prepare {

namespace {

void count_range(ConfigFields& f, const std::string& name, CountRange& range) {
  const auto read = [&](const Json& pair) {
    const auto is_count = [](const Json& number) { return number.is_number_integer() && number >= 0; };
    if (!pair.is_array() || pair.size() != 2 || !is_count(pair[0]) || !(is_count(pair[1]) || pair[1].is_null()))
      throw f.error(name, "expected [least, most], most may be null");
    range.least = pair[0].get<std::size_t>();
    range.most = pair[1].is_null() ? CountRange().most : pair[1].get<std::size_t>();
  };
  f.custom(name, {{"type", "array"}}, read, [&] {
    return Json::array({range.least, range.most == CountRange().most ? Json() : Json(range.most)});
  });
}

/// Empty when the count is allowed.
std::string broken_range(const std::string& what, std::size_t count, const CountRange& range) {
  if (range.holds(count)) return "";
  const bool few = count < range.least;
  return std::to_string(count) + " " + what + ", " + (few ? "at least " : "at most ") +
         std::to_string(few ? range.least : range.most);
}

/// "3 joints merged: b into a, d into c and 1 more"
std::string told(const std::vector<std::string>& each, const std::string& what) {
  return std::to_string(each.size()) + " joints " + what + ": " + listed(each);
}

using Eigen::Matrix4d;

/// New index of every joint.
struct Plan {
  std::vector<int> kept;     ///< old numbers in the new order, parents first
  std::vector<int> number;   ///< [J] new number, -1 for a removed joint
  std::vector<int> parents;  ///< [kept] new numbers
  std::vector<char> moved;   ///< [kept] hangs on another joint than before
};

Plan make_plan(const Skeleton& skeleton, const std::vector<int>& heir) {
  const std::size_t joints = skeleton.size();
  std::vector<int> tops, above(joints, -1);
  std::vector<std::size_t> stay;
  if (heir.size() != joints) throw Error("remove_joints: one heir per joint");
  for (std::size_t j = 0; j < joints; ++j) {
    const int h = heir[j];
    const bool stays = h == static_cast<int>(j);
    if (!stays && (h < -1 || h > static_cast<int>(j) || (h >= 0 && heir[at(h)] != h)))
      throw Error("remove_joints: joint " + std::to_string(j) + " has no heir that stays");
    if (!stays) continue;
    stay.push_back(j);
    const int parent = skeleton.parents[j];
    above[j] = parent < 0 ? -1 : heir[at(parent)];
    if (above[j] < 0) tops.push_back(static_cast<int>(j));
  }
  if (tops.empty()) throw Error("remove_joints: not one joint stays");

  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int top : tops) mean += positions[at(top)] / static_cast<double>(tops.size());
  const int root = *std::min_element(tops.begin(), tops.end(), [&](int a, int b) {
    return (positions[at(a)] - mean).squaredNorm() < (positions[at(b)] - mean).squaredNorm();
  });
  Plan plan;
  plan.number.assign(joints, -1);
  plan.kept.push_back(root);
  for (const std::size_t j : stay) {
    if (static_cast<int>(j) != root) plan.kept.push_back(static_cast<int>(j));
  }
  for (std::size_t n = 0; n < plan.kept.size(); ++n) plan.number[at(plan.kept[n])] = static_cast<int>(n);
  for (const int j : plan.kept) {
    const int parent = above[at(j)] >= 0 ? above[at(j)] : j == root ? -1 : root;
    plan.parents.push_back(parent < 0 ? -1 : plan.number[at(parent)]);
    plan.moved.push_back(parent != skeleton.parents[at(j)] ? 1 : 0);
  }
  return plan;
}

/// Relative to the new parent. A joint can rest at scale 0, under which nothing has a place: then it stays at its own.
Transform local_of(const Matrix4d* parent, const Matrix4d& world, const Transform& otherwise) {
  const Matrix4d local = parent == nullptr ? world : Matrix4d(parent->inverse() * world);
  if (!local.allFinite()) return otherwise;
  const Transform result = decompose(local);
  return result.translation.allFinite() && result.scale.allFinite() ? result : otherwise;
}

/// The joint and everything above it in the old tree.
void add_chain(const Skeleton& skeleton, int joint, std::set<int>& chain) {
  for (; joint >= 0 && chain.insert(joint).second; joint = skeleton.parents[at(joint)]) {
  }
}

Animation moved_animation(const Animation& animation, const Skeleton& skeleton, const Plan& plan) {
  Animation result;
  result.name = animation.name;
  std::vector<std::vector<const Channel*>> channels(skeleton.size());
  for (const Channel& channel : animation.channels) {
    channels[at(channel.joint)].push_back(&channel);
    const int number = plan.number[at(channel.joint)];
    if (number < 0 || plan.moved[at(number)] != 0) continue;
    result.channels.push_back(channel);
    result.channels.back().joint = number;
  }
  // Times at which each joint that hangs elsewhere needs keys: whatever moves it or its new parent on its own.
  std::vector<std::set<double>> times(plan.kept.size());
  std::vector<char> is_step(plan.kept.size(), 1);
  std::set<double> all_times;
  for (std::size_t n = 0; n < plan.kept.size(); ++n) {
    if (plan.moved[n] == 0) continue;
    std::set<int> chain, shared;
    add_chain(skeleton, plan.kept[n], chain);
    if (plan.parents[n] >= 0) add_chain(skeleton, plan.kept[at(plan.parents[n])], shared);
    for (const auto* some : {&chain, &shared}) {
      for (const int joint : *some) {
        const bool in_both = chain.count(joint) > 0 && shared.count(joint) > 0;
        if (in_both) continue;
        for (const Channel* channel : channels[at(joint)]) {
          times[n].insert(channel->times.begin(), channel->times.end());
          if (channel->interpolation != Interpolation::kStep) is_step[n] = 0;
        }
      }
    }
    all_times.insert(times[n].begin(), times[n].end());
  }
  std::vector<std::vector<Channel>> made(plan.kept.size());
  for (const double t : all_times) {
    const Pose pose = sample(animation, skeleton, t);
    const std::vector<Matrix4d> world = forward_kinematics(skeleton.parents, pose);
    for (std::size_t n = 0; n < plan.kept.size(); ++n) {
      if (times[n].count(t) == 0) continue;
      if (made[n].empty()) {
        for (const ChannelPath path : {ChannelPath::kTranslation, ChannelPath::kRotation, ChannelPath::kScale}) {
          Channel channel;
          channel.joint = static_cast<int>(n);
          channel.path = path;
          channel.interpolation = is_step[n] != 0 ? Interpolation::kStep : Interpolation::kLinear;
          made[n].push_back(std::move(channel));
        }
      }
      const int parent = plan.parents[n];
      const Transform local = local_of(parent < 0 ? nullptr : &world[at(plan.kept[at(parent)])],
                                       world[at(plan.kept[n])], pose[at(plan.kept[n])]);
      for (Channel& channel : made[n]) channel.times.push_back(t);
      const auto append = [](Channel& channel, const double* values, std::ptrdiff_t count) {
        channel.values.insert(channel.values.end(), values, values + count);
      };
      append(made[n][0], local.translation.data(), 3);
      append(made[n][1], local.rotation.coeffs().data(), 4);
      append(made[n][2], local.scale.data(), 3);
    }
  }
  for (std::vector<Channel>& some : made) {
    for (Channel& channel : some) result.channels.push_back(std::move(channel));
  }
  return result;
}

SkinWeights moved_weights(const SkinWeights& skin, const std::vector<int>& heir, const Plan& plan) {
  SkinWeights result;
  std::vector<Influence> row;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    row.assign(skin.row(v), skin.row(v) + skin.row_size(v));
    for (Influence& influence : row) {
      const int taker = heir[at(influence.joint)];
      if (taker < 0) throw Error("remove_joints: a joint with weights has no heir");
      influence.joint = plan.number[at(taker)];
    }
    result.append_row(row);
  }
  return result;
}

}  // namespace

void CleaningOptions::fields(ConfigFields& f) {
  count_range(f, "vertices", vertices);
  count_range(f, "joints", joints);
  f("max_outside_share", max_outside_share);
  f("least_weight_sum", least_weight_sum);
  f("drop_duplicate_names", drop_duplicate_names);
  f("duplicate_joints", duplicate_joints, {{"keep", DuplicateJoints::kKeep}, {"merge", DuplicateJoints::kMerge}});
  f("merge_distance", merge_distance);
  f("unused_joints", unused_joints,
    {{"keep", UnusedJoints::kKeep},
     {"prune-leaves", UnusedJoints::kPruneLeaves},
     {"prune-all", UnusedJoints::kPruneAll}});
  const auto read_shares = [&](const Json& pair) {
    if (!pair.is_array() || pair.size() != 2 || !pair[0].is_number() || !pair[1].is_number())
      throw f.error("kept_joints", "expected [least, most]");
    kept_joints = {pair[0].get<double>(), pair[1].get<double>()};
  };
  f.custom("kept_joints", {{"type", "array"}}, read_shares, [&] {
    return Json::array({kept_joints.least, kept_joints.most});
  });
}

void CleaningOptions::validate(const std::string& file, const std::string& pointer) const {
  const auto check = [&](bool valid, const char* option, const char* problem) {
    if (!valid) throw InputError(file, pointer + "/" + option, problem);
  };
  check(vertices.least <= vertices.most, "vertices", "the least exceeds the most");
  check(joints.least <= joints.most, "joints", "the least exceeds the most");
  check(max_outside_share >= 0.0 && max_outside_share <= 1.0, "max_outside_share", "must lie in [0, 1]");
  check(least_weight_sum >= 0.0 && least_weight_sum <= 1.0, "least_weight_sum", "must lie in [0, 1]");
  check(kept_joints.least > 0.0 && kept_joints.least <= kept_joints.most && kept_joints.most <= 1.0, "kept_joints",
        "needs 0 < least <= most <= 1");
  check(merge_distance >= 0.0 && std::isfinite(merge_distance), "merge_distance", "must not be negative");
}

CleaningOptions cleaning_preset(const std::string& name) {
  CleaningOptions options;
  if (name == "none") return options;
  if (name == "anymate") {
    options.vertices = {129, 65534};
    options.joints = {9, 63};
    options.max_outside_share = 0.7;
    options.unused_joints = UnusedJoints::kPruneAll;
    return options;
  }
  if (name == "articulation-xl") {
    options.least_weight_sum = 0.9;
    options.drop_duplicate_names = true;
    options.duplicate_joints = DuplicateJoints::kMerge;
    options.merge_distance = 0.0025;
    return options;
  }
  throw InputError("", "--clean", "\"" + name + "\" is none of none, anymate, articulation-xl");
}

CleanedOut::CleanedOut(const std::string& file, CleaningFinding finding)
    : InputError(file, finding.rule, finding.detail), finding_(std::move(finding)) {}

std::vector<CleaningFinding> clean(Asset& asset, const ReadQuality& quality, const CleaningOptions& options,
                                   const std::string& file) {
  std::vector<CleaningFinding> findings;
  const auto keep = [&findings](std::optional<CleaningFinding> finding) {
    if (finding) findings.push_back(std::move(*finding));
  };
  const auto drop_when = [&file](bool broken, const std::string& rule, const std::string& detail) {
    if (broken) throw CleanedOut(file, {rule, "dropped", detail});
  };
  drop_when(options.drop_duplicate_names && quality.repeated_names > 0, "duplicate_joint_names",
            std::to_string(quality.repeated_names) + " joints have a name that another joint has");
  drop_when(quality.lowest_weight_sum < options.least_weight_sum, "low_weight_sum",
            "the weights of a vertex sum to " + significant(quality.lowest_weight_sum, 3) + ", at least " +
                significant(options.least_weight_sum, 3));
  if (options.duplicate_joints == DuplicateJoints::kMerge) keep(merge_duplicate_joints(asset, options.merge_distance));
  keep(prune_unused_joints(asset, options.unused_joints));
  const std::string vertices = broken_range("vertices", asset.mesh.vertices.size(), options.vertices);
  drop_when(!vertices.empty(), "vertex_count", vertices);
  const std::string joints = broken_range("joints", asset.skeleton.size(), options.joints);
  drop_when(!joints.empty(), "joint_count", joints);
  const double outside = outside_share(asset.skeleton.positions(), asset.mesh);
  drop_when(outside > options.max_outside_share, "outside_mesh",
            significant(100 * outside, 3) + " % of the joints lie outside the mesh, at most " +
                significant(100 * options.max_outside_share, 3) + " %");
  return findings;
}

void count(const std::vector<CleaningFinding>& findings, CleaningCounts& counts) {
  for (const CleaningFinding& finding : findings) ++counts[finding.rule][finding.action];
}

std::optional<CleaningFinding> merge_duplicate_joints(Asset& asset, double distance) {
  const std::vector<Eigen::Vector3d> positions = asset.skeleton.positions();
  std::vector<int> heir, kept;
  std::vector<std::string> merged;
  for (std::size_t j = 0; j < positions.size(); ++j) {
    heir.push_back(static_cast<int>(j));
    for (const int k : kept) {
      if ((positions[at(k)] - positions[j]).norm() > distance) continue;
      heir[j] = k;
      merged.push_back(asset.skeleton.names[j] + " into " + asset.skeleton.names[at(k)]);
      break;
    }
    if (heir[j] == static_cast<int>(j)) kept.push_back(heir[j]);
  }
  if (merged.empty()) return std::nullopt;
  remove_joints(asset, heir);
  return CleaningFinding{"duplicate_joints", "changed", told(merged, "merged")};
}

std::optional<CleaningFinding> prune_unused_joints(Asset& asset, UnusedJoints which) {
  if (which == UnusedJoints::kKeep) return std::nullopt;
  const std::vector<int>& parents = asset.skeleton.parents;
  std::vector<char> stays = weighted_joints(asset);
  if (which == UnusedJoints::kPruneLeaves) {
    for (std::size_t j = stays.size(); j-- > 1;) {  // children come after their parents
      if (stays[j] != 0) stays[at(parents[j])] = 1;
    }
  }
  std::vector<int> heir(stays.size(), -1);
  std::vector<std::string> pruned;
  for (std::size_t j = 0; j < stays.size(); ++j) {
    if (stays[j] != 0) {
      heir[j] = static_cast<int>(j);
      continue;
    }
    if (parents[j] >= 0) heir[j] = heir[at(parents[j])];
    pruned.push_back(asset.skeleton.names[j]);
  }
  if (pruned.empty()) return std::nullopt;
  remove_joints(asset, heir);
  return CleaningFinding{"unused_joints", "changed", told(pruned, "without weights pruned")};
}

std::vector<int> coarser_heirs(const Skeleton& skeleton, const std::vector<char>& weighted, std::size_t wanted) {
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  std::vector<int> heir(skeleton.size());
  for (std::size_t j = 0; j < heir.size(); ++j) heir[j] = static_cast<int>(j);
  // Parents come before children, so that one pass passes everything on to what still stays.
  const auto heir_of_parent = [&](std::size_t j) { return heir[at(skeleton.parents[j])]; };
  for (std::size_t left = heir.size(); left > std::max<std::size_t>(wanted, 1); --left) {
    std::size_t least = 0;
    std::tuple<char, double> least_worth{2, 0.0};
    for (std::size_t j = 0; j < heir.size(); ++j) {
      if (heir[j] != static_cast<int>(j) || skeleton.parents[j] < 0) continue;
      const double bone = (positions[j] - positions[at(heir_of_parent(j))]).norm();
      const std::tuple<char, double> worth{weighted[j], bone};
      if (worth < least_worth) std::tie(least, least_worth) = std::make_tuple(j, worth);
    }
    if (std::get<0>(least_worth) == 2) break;  // only roots are left
    for (std::size_t j = least; j < heir.size(); ++j) {
      if (j == least || heir[j] != static_cast<int>(j)) heir[j] = heir_of_parent(j);
    }
  }
  return heir;
}

std::optional<CleaningFinding> coarsen_skeleton(Asset& asset, const ShareRange& share, const std::string& name) {
  constexpr double kFewest = 2.0;
  const std::size_t joints = asset.skeleton.size();
  const double drawn = Rng(0, "share of joints kept of " + name).uniform(share.least, share.most);
  const auto wanted = static_cast<std::size_t>(std::max(kFewest, std::round(drawn * static_cast<double>(joints))));
  if (wanted >= joints) return std::nullopt;
  remove_joints(asset, coarser_heirs(asset.skeleton, weighted_joints(asset), wanted));
  return CleaningFinding{"kept_joints", "changed",
                         std::to_string(asset.skeleton.size()) + " of " + std::to_string(joints) + " joints kept"};
}

std::vector<char> weighted_joints(const Asset& asset) {
  std::vector<char> weighted(asset.skeleton.size(), 0);
  for (const Influence& influence : asset.skin.influences) weighted[at(influence.joint)] = 1;
  return weighted;
}

void remove_joints(Asset& asset, const std::vector<int>& heir) {
  const Skeleton& old = asset.skeleton;
  const Plan plan = make_plan(old, heir);
  if (plan.kept.size() == old.size()) return;
  asset.skin = moved_weights(asset.skin, heir, plan);
  std::vector<Animation> animations;
  for (const Animation& animation : asset.animations) {
    Animation moved = moved_animation(animation, old, plan);
    if (!moved.channels.empty()) animations.push_back(std::move(moved));
  }
  asset.animations = std::move(animations);
  const std::vector<Matrix4d> rest = forward_kinematics(old.parents, old.rest);
  Skeleton skeleton;
  for (std::size_t n = 0; n < plan.kept.size(); ++n) {
    const std::size_t j = at(plan.kept[n]);
    skeleton.names.push_back(old.names[j]);
    skeleton.parents.push_back(plan.parents[n]);
    skeleton.bind.push_back(old.bind[j]);
    const Matrix4d* parent = plan.parents[n] < 0 ? nullptr : &rest[at(plan.kept[at(plan.parents[n])])];
    skeleton.rest.push_back(plan.moved[n] == 0 ? old.rest[j] : local_of(parent, rest[j], old.rest[j]));
  }
  asset.skeleton = std::move(skeleton);
}

}  // namespace anigen::prepare
