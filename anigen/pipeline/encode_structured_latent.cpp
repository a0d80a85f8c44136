#include "anigen/pipeline/encode_structured_latent.h"

#include <system_error>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/io/gltf.h"
#include "anigen/loaders/files/rig_arrays.h"
#include "anigen/loaders/files/voxel_files.h"
#include "anigen/pipeline/device.h"
#include "anigen/pipeline/structured_latent_coder.h"
#include "anigen/pipeline/votes_cloud.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr const char* kVotes[] = {".votes.glb", ".votes.ply"};

// [N, C] → [C, N].
std::vector<float> by_channel(const std::vector<float>& rows, std::size_t channels) {
  const std::size_t count = channels == 0 ? 0 : rows.size() / channels;
  std::vector<float> planes(rows.size());
  for (std::size_t n = 0; n < count; ++n) {
    for (std::size_t c = 0; c < channels; ++c) planes[c * count + n] = rows[n * channels + c];
  }
  return planes;
}

class StructuredLatents : public LatentSource {
 public:
  explicit StructuredLatents(const EncodeRequest& request)
      : coder_(request.run, request.ckpt, parse_device(request.device), /*decodes=*/std::nullopt) {}

  fs::path checkpoint() const override { return coder_.checkpoint(); }
  std::string fingerprint() const override { return coder_.fingerprint(); }
  std::string required_flag() const override { return "feature_" + coder_.feature_model(); }
  std::vector<fs::path> inputs(const loaders::AssetId& asset) const override { return coder_.files(asset); }
  std::size_t normalized_channels() const override { return static_cast<std::size_t>(coder_.geometry_channels()); }

  void encode(const loaders::AssetId& asset, const fs::path& file) override {
    coder_.write(coder_.encode(coder_.inputs(asset)), file);
  }

  LatentValues read(const fs::path& file) const override {
    const loaders::VoxelRows shape = loaders::read_voxel_arrays(file, "coords", "feats");
    const loaders::VoxelRows skeleton = loaders::read_voxel_arrays(file, "coords_skl", "feats_skl");
    return {by_channel(shape.feats, shape.channels), by_channel(skeleton.feats, skeleton.channels), shape.channels,
            skeleton.channels};
  }

 private:
  StructuredLatentCoder coder_;
};

std::vector<std::string> wanted_ids(const ReconstructRequest& request) {
  std::vector<std::string> ids = request.ids;
  if (!request.split.empty()) {
    for (const std::string& id : loaders::read_split(request.split, request.data.string())) ids.push_back(id);
  }
  if (ids.empty()) throw InputError("", "--id", "neither --id nor --split names an asset");
  for (const std::string& id : ids) {
    if (id.empty() || id.front() == '.' || id.find_first_of("/\\") != std::string::npos) {
      throw InputError("", "--id", "'" + id.substr(0, 80) + "' is no id of an asset");
    }
  }
  return ids;
}

/// A dataset's own assets count as inputs: --output may name the folder where they are.
void refuse_lossy_outputs(const ReconstructRequest& request, const std::vector<std::string>& ids) {
  std::vector<fs::path> outputs;
  for (const std::string& id : ids) {
    outputs.push_back(request.output / (id + ".glb"));
    for (const char* extension : kVotes) outputs.push_back(request.output / (id + extension));
  }
  refuse_to_overwrite(outputs, [&] {
    std::vector<fs::path> inputs = {request.split};
    loaders::AssetId asset;
    asset.root = request.data;
    for (const std::string& id : ids) {
      asset.id = id;
      inputs.push_back(request.data / "assets" / (id + ".glb"));
      inputs.push_back(loaders::skeleton_voxel_path(asset));
      inputs.push_back(loaders::rig_path(asset));
    }
    return inputs;
  });
}

void reconstruct(const ReconstructRequest& request, StructuredLatentCoder& coder, ReconstructedAsset& one) {
  loaders::AssetId asset;
  asset.root = request.data;
  asset.id = one.id;
  const StructuredLatentCoder::Inputs inputs = coder.inputs(asset);
  const fields::SkeletonTensors own{inputs.rigs.joints.front(), inputs.rigs.parents.front().to(torch::kInt64)};
  one.true_joints = static_cast<std::size_t>(own.joints.size(0));
  const auto decoded = coder.decode(coder.encode(inputs), own, request.true_skeleton, one.id);
  one.joints = decoded.asset.skeleton.size();
  one.vertices = decoded.asset.mesh.vertices.size();
  one.faces = decoded.asset.mesh.faces.size();
  one.file = request.output / (one.id + ".glb");
  io::write_gltf(one.file, decoded.asset);
  if (!request.votes) return;
  for (const char* extension : kVotes) {
    write_votes(request.output / (one.id + extension), decoded.votes);
  }
}

}  // namespace

EncodedLatents encode_structured_latents(const EncodeRequest& request) {
  const LatentFolder folder(request.data, request.name, request.run, LatentKind::kStructured);
  StructuredLatents source(request);
  return encode_latents(request, folder, source);
}

std::vector<ReconstructedAsset> reconstruct_assets(const ReconstructRequest& request) {
  const std::vector<std::string> ids = wanted_ids(request);
  refuse_lossy_outputs(request, ids);
  StructuredLatentCoder coder(request.run, request.ckpt, parse_device(request.device), request.grouping);
  if (coder.shape_alone()) {
    for (const auto& [wanted, option] :
         {std::pair(request.votes, "--votes"), {request.true_skeleton, "--true-skeleton"}})
      if (wanted) throw InputError(request.run.string(), option, "this run trained the shape alone");
    log::info("the run trained the shape alone: files with one joint");
  }
  std::error_code error;
  fs::create_directories(request.output, error);
  if (error) throw Error(request.output.string() + ": cannot create folder: " + error.message());
  std::vector<ReconstructedAsset> made;
  Progress progress("reconstructing", ids.size(), "assets");
  for (const std::string& id : ids) {
    throw_if_interrupted();
    ReconstructedAsset one;
    one.id = id;
    try {
      reconstruct(request, coder, one);
    } catch (...) {
      one.failure = failure_of_item();
      log::warn("{}: {}", id, one.failure);
    }
    made.push_back(std::move(one));
    progress.advance();
  }
  progress.finish();
  return made;
}

Json to_json(const std::vector<ReconstructedAsset>& assets) {
  Json list = Json::array();
  for (const ReconstructedAsset& asset : assets) {
    list.push_back({{"id", asset.id},
                    {"file", asset.file.string()},
                    {"joints", asset.joints},
                    {"true_joints", asset.true_joints},
                    {"vertices", asset.vertices},
                    {"faces", asset.faces}});
    if (!asset.failure.empty()) list.back()["failure"] = asset.failure;
  }
  return list;
}

std::string to_text(const std::vector<ReconstructedAsset>& assets) {
  std::string text;
  for (const ReconstructedAsset& asset : assets) {
    if (!asset.failure.empty()) {
      text += asset.id + ": no file: " + asset.failure + "\n";
      continue;
    }
    text += asset.file.string() + ": " + std::to_string(asset.joints) + " joints (of " +
            std::to_string(asset.true_joints) + "), " + std::to_string(asset.vertices) + " vertices, " +
            std::to_string(asset.faces) + " faces\n";
  }
  return text;
}

}  // namespace anigen::pipeline
