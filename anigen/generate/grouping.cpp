#include "anigen/generate/grouping.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <set>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/data/metadata.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/generate/asset_maker.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/generate/stage_generators.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/nn/init.h"
#include "anigen/structured_latent/decoder.h"

namespace anigen::generate {

namespace {

using Eigen::Vector3f;

constexpr double kBandwidths[] = {0.004, 0.006, 0.008, 0.01, 0.014, 0.017, 0.02, 0.025, 0.03, 0.035, 0.04, 0.05};
constexpr int kLeastVotes[] = {1, 2, 3, 4, 5, 7, 10, 14, 20, 24, 28, 40};

struct VotedAsset {
  skeleton_field::Votes votes;
  std::vector<Vector3f> joints;        // true ones
  skeleton_field::MeanShiftForm form;  // that the run groups in
};

// The joints that are not within kCoincide of an earlier one.
std::vector<Vector3f> distinct(const std::vector<Vector3f>& joints) {
  std::vector<Vector3f> kept;
  for (const Vector3f& joint : joints) {
    const auto near = [&](const Vector3f& other) { return static_cast<double>((joint - other).norm()) <= kCoincide; };
    if (std::none_of(kept.begin(), kept.end(), near)) kept.push_back(joint);
  }
  return kept;
}

double mean_nearest(const std::vector<Vector3f>& from, const std::vector<Vector3f>& to) {
  double sum = 0.0;
  for (const Vector3f& a : from) {
    float nearest = (a - to.front()).norm();
    for (const Vector3f& b : to) nearest = std::min(nearest, (a - b).norm());
    sum += static_cast<double>(nearest);
  }
  return sum / static_cast<double>(from.size());
}

// Pairs by rising distance, each joint in one at most.
std::size_t matched_within(const std::vector<Vector3f>& a, const std::vector<Vector3f>& b, double limit) {
  struct Pair {
    float distance;
    std::size_t i, k;
  };
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t k = 0; k < b.size(); ++k) {
      const float distance = (a[i] - b[k]).norm();
      if (static_cast<double>(distance) <= limit) pairs.push_back({distance, i, k});
    }
  }
  std::sort(pairs.begin(), pairs.end(), [](const Pair& x, const Pair& y) { return x.distance < y.distance; });
  std::vector<bool> taken_a(a.size()), taken_b(b.size());
  std::size_t matched = 0;
  for (const Pair& pair : pairs) {
    if (taken_a[pair.i] || taken_b[pair.k]) continue;
    taken_a[pair.i] = taken_b[pair.k] = true;
    ++matched;
  }
  return matched;
}

GroupingRow scored(const std::vector<VotedAsset>& assets, double bandwidth, int least_votes, double limit) {
  GroupingRow row{bandwidth, least_votes};
  skeleton_field::MeanShiftOptions options;
  options.bandwidth = static_cast<float>(bandwidth);
  options.min_cluster_size = least_votes;
  for (const VotedAsset& asset : assets) {
    options.form = asset.form;
    const std::vector<Vector3f> joints = skeleton_field::mean_shift_grouping(asset.votes, options).joints;
    const auto found = static_cast<double>(joints.size()), wanted = static_cast<double>(asset.joints.size());
    row.surplus += found - wanted;
    row.off += std::abs(found - wanted);
    if (joints.empty()) {
      row.j2j += 1.0;
      continue;
    }
    row.f1 += 2.0 * static_cast<double>(matched_within(joints, asset.joints, limit)) / (found + wanted);
    row.j2j += 0.5 * (mean_nearest(joints, asset.joints) + mean_nearest(asset.joints, joints));
  }
  for (double* value : {&row.f1, &row.j2j, &row.surplus, &row.off}) *value /= static_cast<double>(assets.size());
  return row;
}

// Votes of latents that flows make of images.
std::vector<VotedAsset> generated_votes(const GroupingRequest& request) {
  GenerateRequest generation;
  generation.models.structure_flow = request.ss_flow;
  generation.models.latent_flow = request.slat_flow;
  generation.models.device = request.device;
  AssetGenerator generator(generation.models);
  ConditionPictures conditions(generation, generator);
  const StructuredLatentCoder coder = generator.latent_coder();
  const std::vector<NamedPicture> pictures = pictures_of_dataset(request.data, request.splits, request.most);
  std::vector<VotedAsset> assets;
  Progress progress("generating votes", pictures.size(), "assets");
  for (const NamedPicture& picture : pictures) {
    throw_if_interrupted();
    data::AssetId asset;
    asset.root = request.data;
    asset.id = picture.name;
    const torch::Tensor joints = coder.inputs(asset).rigs.joints.front();
    const std::map<int, PreprocessedImage> seen = conditions.of(picture);
    const PreprocessedImage& first = seen.at(generator.structure_size());
    try {
      const GeneratedAsset made =
          generator.generate(generator.structure_sees_normals() ? first.normals_tensor : first.picture_tensor,
                             seen.at(generator.latent_size()).picture_tensor, picture.name, {});
      assets.push_back({skeleton_field::votes_of(made.decoded.votes), distinct(nn::points_of(joints, "joints")),
                        coder.grouping_form()});
    } catch (const Error& error) {
      log::warn("{}: {}", picture.name, error.what());
    }
    progress.advance();
  }
  progress.finish();
  if (assets.empty()) throw Error(request.slat_flow.string() + ": the flows made nothing of any image");
  return assets;
}

// Votes of flows that see the meshes of assets.
std::vector<VotedAsset> votes_in_meshes(const GroupingRequest& request) {
  FieldRigger::Request flows;
  flows.flows = {request.ss_flow, request.slat_flow};
  flows.device = request.device;
  FieldRigger rigger(flows);
  const auto source = io::open_source(request.data);
  std::vector<std::string> ids = io::select_ids(*source, request.splits);
  if (request.most > 0 && ids.size() > request.most) ids.resize(request.most);
  std::vector<VotedAsset> assets;
  Progress progress("finding votes", ids.size(), "assets");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    const io::RiggedShape shape = source->read(id);
    try {
      const FieldRigger::Found found = rigger.find(shape);
      std::vector<Vector3f> joints;
      for (const Eigen::Vector3d& joint : shape.joints.positions)
        joints.emplace_back((found.to_cube.scale * joint + found.to_cube.offset).cast<float>());
      assets.push_back({skeleton_field::votes_of(found.votes), distinct(joints), rigger.grouping_form()});
    } catch (const InputError&) {
      throw;
    } catch (const Error& error) {
      log::warn("{}: {}", id, error.what());
    }
    progress.advance();
  }
  progress.finish();
  if (assets.empty()) throw Error(request.slat_flow.string() + ": the flows find no votes in any mesh");
  return assets;
}

std::vector<VotedAsset> voted_assets(const GroupingRequest& request) {
  if (!request.slat_flow.empty() && is_rig_flow(request.slat_flow)) return votes_in_meshes(request);
  std::set<std::string> ids;
  for (const std::filesystem::path& split : request.splits) ids.merge(data::read_split(split, request.data.string()));
  if (ids.empty()) throw InputError("", "--split", "names no asset");
  if (!request.slat_flow.empty()) return generated_votes(request);
  StructuredLatentCoder coder(request.run, request.ckpt, nn::parse_device(request.device),
                              skeleton_field::MeanShiftOptions{});
  if (coder.shape_alone()) throw InputError(request.run.string(), "", "this run trained the shape alone: no votes");
  std::vector<VotedAsset> assets;
  const std::size_t count = request.most == 0 ? ids.size() : std::min(request.most, ids.size());
  Progress progress("decoding votes", count, "assets");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    if (assets.size() == count) break;
    data::AssetId asset;
    asset.root = request.data;
    asset.id = id;
    const StructuredLatentCoder::Inputs inputs = coder.inputs(asset);
    const skeleton_field::SkeletonTensors own{inputs.rigs.joints.front(),
                                              inputs.rigs.parents.front().to(torch::kInt64)};
    // With the true skeleton, so that nothing is grouped and no weights of many false joints are decoded.
    const RigDecoder::Decoded decoded = coder.decode(coder.encode(inputs), own, /*use_own=*/true, id);
    assets.push_back({skeleton_field::votes_of(decoded.votes), distinct(nn::points_of(own.joints, "joints")),
                      coder.grouping_form()});
    progress.advance();
  }
  progress.finish();
  return assets;
}

}  // namespace

GroupingFit fit_grouping(const GroupingRequest& request) {
  const std::vector<VotedAsset> assets = voted_assets(request);
  const bool generated = !request.slat_flow.empty();
  const bool seen = generated && !is_rig_flow(request.slat_flow);
  const double limit = seen ? kGeneratedMatchDistance : kMatchDistance;
  GroupingFit fit;
  fit.assets = assets.size();
  for (const double bandwidth : kBandwidths) {
    for (const int votes : kLeastVotes) {
      throw_if_interrupted();
      fit.rows.push_back(scored(assets, bandwidth, votes, limit));
    }
  }
  std::stable_sort(fit.rows.begin(), fit.rows.end(), [](const GroupingRow& a, const GroupingRow& b) {
    return a.f1 != b.f1 ? a.f1 > b.f1 : a.j2j < b.j2j;
  });
  const double least_f1 = fit.rows.front().f1 - kNearlyBest;
  auto chosen = fit.rows.begin();
  for (auto row = fit.rows.begin(); row != fit.rows.end() && row->f1 >= least_f1; ++row)
    if (row->off < chosen->off) chosen = row;
  std::rotate(fit.rows.begin(), chosen, chosen + 1);
  const GroupingRow& best = fit.rows.front();
  const std::filesystem::path file = structured_latent::grouping_file(generated ? request.slat_flow : request.run);
  std::error_code error;
  Json written = std::filesystem::is_regular_file(file, error) ? read_json(file) : Json::object();
  written.update(Json{{"bandwidth", best.bandwidth},
                      {"least_votes", best.least_votes},
                      {"assets", fit.assets},
                      {"f1", best.f1},
                      {"off", best.off}});
  write_file_atomically(file, written.dump(2) + "\n");
  log::info("wrote {}", file.string());
  return fit;
}

Json to_json(const GroupingFit& fit) { return {{"assets", fit.assets}, {"rows", fit.rows}}; }

std::string to_markdown(const GroupingFit& fit) {
  std::string text = "| bandwidth | least votes | F1 | J2J | joints off | surplus |\n|--:|--:|--:|--:|--:|--:|\n";
  constexpr std::size_t kShown = 10;
  for (std::size_t i = 0; i < std::min(kShown, fit.rows.size()); ++i) {
    const GroupingRow& row = fit.rows[i];
    char line[128];
    std::snprintf(line, sizeof line, "| %.3f | %d | %.4f | %.4f | %.2f | %+.1f |\n", row.bandwidth, row.least_votes,
                  row.f1, row.j2j, row.off, row.surplus);
    text += line;
  }
  return text;
}

}  // namespace anigen::generate
