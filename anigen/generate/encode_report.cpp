#include "anigen/generate/encode_report.h"

#include <cstdio>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "anigen/data/picture_cache.h"
#include "anigen/data/view_files.h"
#include "anigen/data/voxel_files.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/generate/field_rigger.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/nn/profile.h"

// Prints the result of an encoding.

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;

void add_to(sparse_structure::VoxelAgreement& sum, const sparse_structure::VoxelAgreement& one) {
  sum.iou += one.iou;
  sum.precision += one.precision;
  sum.recall += one.recall;
  sum.f1 += one.f1;
}

sparse_structure::VoxelAgreement divided(sparse_structure::VoxelAgreement sum, std::size_t count) {
  for (double* value : {&sum.iou, &sum.precision, &sum.recall, &sum.f1}) *value /= static_cast<double>(count);
  return sum;
}

class StructureLatents : public LatentSource {
 public:
  explicit StructureLatents(const EncodeRequest& request)
      : check_(request.check), coder_(request.run, request.ckpt, nn::parse_device(request.device), request.check) {}

  fs::path checkpoint() const override { return coder_.checkpoint(); }
  std::string fingerprint() const override { return coder_.fingerprint(); }
  std::string required_flag() const override { return "voxelized"; }
  std::vector<fs::path> inputs(const data::AssetId& asset) const override {
    return {data::surface_voxel_path(asset), data::skeleton_voxel_path(asset)};
  }

  void encode(const data::AssetId& asset, const fs::path& file) override {
    voxels_ = coder_.voxels(asset);
    voxels_of_ = asset.id;
    coder_.encode(*voxels_, file);
  }

  LatentValues read(const fs::path& file) const override {
    data::StructureLatent latent = data::read_structure_latent(file);
    LatentValues values;
    values.shape_channels = static_cast<std::size_t>(latent.mean.shape[0]);
    values.skeleton_channels = static_cast<std::size_t>(latent.mean_skl.shape[0]);
    values.shape = std::move(latent.mean.values);
    values.skeleton = std::move(latent.mean_skl.values);
    return values;
  }

  void inspect(const data::AssetId& asset, const fs::path& file) override {
    if (!check_) return;
    if (!voxels_ || voxels_of_ != asset.id) {
      voxels_ = coder_.voxels(asset);
      voxels_of_ = asset.id;
    }
    const StructureReconstruction one = coder_.agreement(data::read_structure_latent(file), *voxels_);
    add_to(sum_.shape, one.shape);
    add_to(sum_.skeleton, one.skeleton);
    ++inspected_;
  }

  std::optional<StructureReconstruction> reconstruction() const {
    if (inspected_ == 0) return std::nullopt;
    return StructureReconstruction{divided(sum_.shape, inspected_), divided(sum_.skeleton, inspected_)};
  }

 private:
  bool check_;
  StructureCoder coder_;
  std::optional<data::SparseStructureBatch> voxels_;  // of the asset read last
  std::string voxels_of_;
  StructureReconstruction sum_;
  std::size_t inspected_ = 0;
};

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
      : coder_(request.run, request.ckpt, nn::parse_device(request.device), /*decodes=*/std::nullopt) {}

  fs::path checkpoint() const override { return coder_.checkpoint(); }
  std::string fingerprint() const override { return coder_.fingerprint(); }
  std::string required_flag() const override { return "feature_" + coder_.feature_model(); }
  std::vector<fs::path> inputs(const data::AssetId& asset) const override { return coder_.files(asset); }
  std::size_t normalized_channels() const override { return static_cast<std::size_t>(coder_.geometry_channels()); }

  void encode(const data::AssetId& asset, const fs::path& file) override {
    coder_.write(coder_.encode(coder_.inputs(asset)), file);
  }

  LatentValues read(const fs::path& file) const override {
    const data::VoxelRows shape = data::read_voxel_arrays(file, "coords", "feats");
    const data::VoxelRows skeleton = data::read_voxel_arrays(file, "coords_skl", "feats_skl");
    return {by_channel(shape.feats, shape.channels), by_channel(skeleton.feats, skeleton.channels), shape.channels,
            skeleton.channels};
  }

 protected:
  StructuredLatentCoder& coder() { return coder_; }

 private:
  StructuredLatentCoder coder_;
};

StructureGenerator::Request first_flow(const EncodeRequest& request, bool pictures) {
  StructureGenerator::Request flow;
  flow.run = request.ss_flow;
  flow.autoencoder = request.ss_dae;
  flow.device = request.device;
  flow.pictures = pictures;
  return flow;
}

/// Latents at the voxels that a first flow sees in one view of each asset, with surface features that are computed
/// there.
class SeenLatents : public StructuredLatents {
 public:
  explicit SeenLatents(const EncodeRequest& request)
      : StructuredLatents(request),
        view_(request.view),
        flow_(first_flow(request, /*pictures=*/true)),
        pictures_(/*bytes=*/0) {}

  std::string fingerprint() const override {
    return sha256(StructuredLatents::fingerprint() + flow_.fingerprint() + "/" + std::to_string(view_));
  }
  std::vector<fs::path> inputs(const data::AssetId& asset) const override {
    std::vector<fs::path> files = StructuredLatents::inputs(asset);
    const fs::path folder = data::condition_folder(asset);
    files.push_back(folder / data::condition_views(folder).at(view_of(asset)));
    files.push_back(data::surface_voxel_path(asset));
    return files;
  }

  void encode(const data::AssetId& asset, const fs::path& file) override {
    coder().require_features_anywhere(asset);
    const std::size_t view = view_of(asset);
    const std::int64_t size = flow_.reading().image_size;
    const std::vector<float> picture =
        pictures_.read(data::condition_folder(asset), static_cast<int>(size), view, flow_.reading().condition);
    const torch::Tensor condition = flow_.condition(torch::tensor(picture).view({1, 3, size, size}));
    // Noise by the asset's name: the same whatever else is encoded.
    const std::uint64_t number = std::stoull(sha256(asset.id).substr(0, 15), nullptr, 16);
    const flow::Streams sampled = flow_.sample(flow_.noise(/*seed=*/0, number), condition, flow_.sampler(), false);
    const sparse_structure::VoxelPair voxels = flow_.decode(sampled).front();
    if (!voxels.shape.any().item<bool>() || !voxels.skeleton.any().item<bool>())
      throw InputError(asset.id, "", "the first flow sees no voxels in view " + std::to_string(view));
    coder().write(coder().encode(coder().inputs_at(asset, voxels)), file, view);
  }

 private:
  std::size_t view_of(const data::AssetId& asset) const {
    const std::size_t views = data::condition_views(data::condition_folder(asset)).size();
    if (views == 0) throw InputError(data::condition_folder(asset).string(), "", "there are no condition views");
    return view_ % views;
  }

  std::size_t view_;
  StructureGenerator flow_;
  data::PictureCache pictures_;
};

/// Latents at the assets' own voxels of the surface, and at those of the skeleton that a first flow without images
/// finds in them: what the second flow of a FieldRigger meets.
class FoundSkeletonLatents : public StructuredLatents {
 public:
  explicit FoundSkeletonLatents(const EncodeRequest& request)
      : StructuredLatents(request), flow_(first_flow(request, /*pictures=*/false)) {
    if (!flow_.finds_skeletons()) {
      throw InputError(flow_.flow().config.string(), "/trainer/args/p_given_shape",
                       "a flow that finds the skeleton of a shape was trained with 1");
    }
    if (request.view != 0) throw InputError("", "--view", "is of flows that see images; this one sees the mesh");
  }

  std::string fingerprint() const override { return sha256(StructuredLatents::fingerprint() + flow_.fingerprint()); }

  void encode(const data::AssetId& asset, const fs::path& file) override {
    const sparse::SparseTensor shape = coder().inputs(asset).x;
    const torch::Tensor at = shape.support->coords().to(torch::kCPU, torch::kInt64);
    torch::Tensor voxels =
        torch::zeros({coder().resolution(), coder().resolution(), coder().resolution()}, torch::kBool);
    voxels.index_put_({at.select(1, 1), at.select(1, 2), at.select(1, 3)}, true);
    const flow::Streams noise = flow_.noise(noise_generator(FieldRigger::Request().seed));
    const torch::Tensor skeleton = flow_.skeleton_of(voxels, noise).voxels;
    if (!skeleton.any().item<bool>()) throw InputError(asset.id, "", "the first flow finds no skeleton in this asset");
    coder().write(coder().encode(coder().inputs_with_skeleton(asset, skeleton)), file);
  }

 private:
  StructureGenerator flow_;
};

std::vector<std::string> wanted_ids(const ReconstructRequest& request) {
  std::vector<std::string> ids = request.ids;
  for (const fs::path& split : request.splits) {
    for (const std::string& id : data::read_split(split, request.data.string())) ids.push_back(id);
  }
  if (ids.empty()) throw InputError("", "--id", "neither --id nor --split names an asset");
  for (const std::string& id : ids) {
    if (id.empty() || id.front() == '.' || id.find_first_of("/\\") != std::string::npos)
      throw InputError("", "--id", "'" + id.substr(0, 80) + "' is no id of an asset");
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
    std::vector<fs::path> inputs = request.splits;
    data::AssetId asset;
    asset.root = request.data;
    for (const std::string& id : ids) {
      asset.id = id;
      inputs.push_back(request.data / "assets" / (id + ".glb"));
      inputs.push_back(data::skeleton_voxel_path(asset));
      inputs.push_back(data::rig_path(asset));
    }
    return inputs;
  });
}

void reconstruct(const ReconstructRequest& request, StructuredLatentCoder& coder, ReconstructedAsset& one) {
  data::AssetId asset;
  asset.root = request.data;
  asset.id = one.id;
  const StructuredLatentCoder::Inputs inputs = coder.inputs(asset);
  const skeleton_field::SkeletonTensors own{inputs.rigs.joints.front(), inputs.rigs.parents.front().to(torch::kInt64)};
  one.true_joints = static_cast<std::size_t>(own.joints.size(0));
  const auto decoded = coder.decode(coder.encode(inputs), own, request.true_skeleton, one.id);
  one.joints = decoded.asset.skeleton.size();
  one.vertices = decoded.asset.mesh.vertices.size();
  one.faces = decoded.asset.mesh.faces.size();
  one.file = request.output / (one.id + ".glb");
  io::write_gltf(one.file, decoded.asset);
  if (!request.votes) return;
  for (const char* extension : kVotes) write_votes(request.output / (one.id + extension), decoded.votes);
}

Json agreement_json(const sparse_structure::VoxelAgreement& agreement) {
  return {
      {"iou", agreement.iou}, {"precision", agreement.precision}, {"recall", agreement.recall}, {"f1", agreement.f1}};
}

std::string agreement_line(const char* name, const sparse_structure::VoxelAgreement& agreement) {
  char line[160];
  std::snprintf(line, sizeof line, "%-9s IoU %.4f, F1 %.4f (precision %.4f, recall %.4f within 1 voxel)\n", name,
                agreement.iou, agreement.f1, agreement.precision, agreement.recall);
  return line;
}

}  // namespace

EncodeResult encode_sparse_structure(const EncodeRequest& request) {
  const LatentFolder folder(request.data, request.name, request.run);
  StructureLatents source(request);
  EncodeResult result;
  static_cast<EncodedLatents&>(result) = encode_latents(request, folder, source);
  result.reconstruction = source.reconstruction();
  return result;
}

EncodedLatents encode_structured_latents(const EncodeRequest& request) {
  const LatentFolder folder(request.data, request.name, request.run, LatentKind::kStructured);
  if (!request.ss_flow.empty() && is_rig_flow(request.ss_flow)) {
    FoundSkeletonLatents source(request);
    return encode_latents(request, folder, source);
  }
  if (!request.ss_flow.empty()) {
    SeenLatents source(request);
    return encode_latents(request, folder, source);
  }
  StructuredLatents source(request);
  return encode_latents(request, folder, source);
}

std::vector<ReconstructedAsset> reconstruct_assets(const ReconstructRequest& request) {
  const std::vector<std::string> ids = wanted_ids(request);
  refuse_lossy_outputs(request, ids);
  StructuredLatentCoder coder(request.run, request.ckpt, nn::parse_device(request.device), request.grouping);
  if (coder.shape_alone()) {
    for (const auto& [wanted, option] :
         {std::pair(request.votes, "--votes"), {request.true_skeleton, "--true-skeleton"}})
      if (wanted) throw InputError(request.run.string(), option, "this run trained the shape alone");
    log::info("the run trained the shape alone: files with one joint");
  }
  make_folders(request.output);
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

Json to_json(const EncodeResult& result) {
  Json json = to_json(static_cast<const EncodedLatents&>(result));
  if (result.reconstruction) {
    json["reconstruction"] = {{"shape", agreement_json(result.reconstruction->shape)},
                              {"skeleton", agreement_json(result.reconstruction->skeleton)}};
  }
  return json;
}

std::string to_text(const EncodeResult& result) {
  std::string text = to_text(static_cast<const EncodedLatents&>(result), "ss_latents");
  if (result.reconstruction) {
    text += agreement_line("shape", result.reconstruction->shape);
    text += agreement_line("skeleton", result.reconstruction->skeleton);
  }
  return text;
}

}  // namespace anigen::generate
