#include "anigen/pipeline/encode_sparse_structure.h"

#include <algorithm>
#include <exception>
#include <limits>
#include <new>
#include <optional>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/file_lock.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/loaders/files/voxel_files.h"
#include "anigen/pipeline/device.h"
#include "anigen/pipeline/latent_folder.h"
#include "anigen/pipeline/latent_manifest.h"
#include "anigen/pipeline/metadata_flag.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kNamedInLog = 20;

const EncodeRequest& checked(const EncodeRequest& request) {
  if (request.data.string().find(',') != std::string::npos) {
    throw InputError("", "--data", "names one dataset; encode several one after another (its path may hold no comma)");
  }
  return request;
}

/// Latents of everything: what stage 4 trains on, and what it leaves out, is for its own dataset to say.
loaders::RowFilter all_with_voxels() {
  loaders::RowFilter filter;
  filter.min_aesthetic_score = std::numeric_limits<double>::lowest();
  filter.drop_bad_skeleton = false;
  filter.required_flags = {"voxelized"};
  return filter;
}

std::string fingerprint_of_voxels(const loaders::AssetId& asset) {
  return fingerprint_of_files({loaders::surface_voxel_path(asset), loaders::skeleton_voxel_path(asset)});
}

/// Nothing when the file went missing or was damaged since.
std::optional<loaders::StructureLatent> kept_latent(const fs::path& file) {
  try {
    return loaders::read_structure_latent(file);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

void add_to(models::VoxelAgreement& sum, const models::VoxelAgreement& one) {
  sum.iou += one.iou;
  sum.precision += one.precision;
  sum.recall += one.recall;
  sum.f1 += one.f1;
}

models::VoxelAgreement divided(models::VoxelAgreement sum, std::size_t count) {
  for (double* value : {&sum.iou, &sum.precision, &sum.recall, &sum.f1}) *value /= static_cast<double>(count);
  return sum;
}

/// One run over a dataset.
class StructureEncoding {
 public:
  explicit StructureEncoding(const EncodeRequest& request)
      : request_(checked(request)),
        folder_(request.data, request.name, request.run),
        coder_(request.run, request.ckpt, parse_device(request.device), request.check) {
    result_.name = folder_.name();
    result_.checkpoint = coder_.checkpoint();
  }

  EncodeResult run() {
    const torch::NoGradGuard no_grad;
    const FileLock dataset = share_dataset(request_.data);
    const std::optional<FileLock> latents = FileLock::try_lock(
        dataset_lock_file(request_.data).parent_path() / ("lock-" + folder_.column()), FileLock::Kind::kExclusive);
    if (!latents) throw InputError(folder_.path().string(), "", "another anigen-encode is writing these latents");
    const std::vector<loaders::AssetId> assets = loaders::select_assets(request_.data.string(), all_with_voxels());
    result_.assets = assets.size();
    LatentManifest manifest(folder_.path(), coder_.fingerprint());
    const std::set<std::string> kept = up_to_date(assets, manifest);
    invalidate_others(assets, kept, manifest);
    Progress progress("encoding", assets.size(), "assets");
    for (std::size_t i = 0; i < assets.size(); ++i) {
      if (interrupt_requested()) {
        throw Interrupted("stopped; the latents written so far are kept, run the same command to go on");
      }
      attempt(assets[i], kept.count(assets[i].id) > 0, manifest);
      progress.advance();
      if (request_.progress) request_.progress(i + 1, assets.size());
    }
    progress.finish();
    manifest.save();
    conclude();
    return result_;
  }

 private:
  /// Ids whose latents need not be made again.
  std::set<std::string> up_to_date(const std::vector<loaders::AssetId>& assets, const LatentManifest& manifest) const {
    std::set<std::string> kept;
    for (const loaders::AssetId& asset : assets) {
      throw_if_interrupted();
      if (request_.again || !manifest.has(asset.id)) continue;
      std::error_code error;
      try {
        const bool there = fs::is_regular_file(folder_.file(asset.id), error);
        if (there && manifest.up_to_date(asset.id, fingerprint_of_voxels(asset))) kept.insert(asset.id);
      } catch (const InputError&) {  // voxels that cannot be read: said when the asset's turn comes
      }
    }
    return kept;
  }

  /// Before the first file is replaced nothing may promise it any more, neither to training nor to the next run.
  void invalidate_others(const std::vector<loaders::AssetId>& assets, const std::set<std::string>& kept,
                         LatentManifest& manifest) const {
    std::vector<std::string> others;
    for (const loaders::AssetId& asset : assets) {
      if (kept.count(asset.id) == 0) others.push_back(asset.id);
    }
    if (others.empty()) return;
    set_metadata_flag(request_.data, folder_.column(), kept);
    folder_.remove_statistics();
    manifest.forget(others);
  }

  void attempt(const loaders::AssetId& asset, bool keep, LatentManifest& manifest) {
    try {
      treat(asset, keep, manifest);
    } catch (const Interrupted&) {
      throw;
    } catch (const std::bad_alloc&) {
      throw;
    } catch (const c10::Error& error) {
      note_failure(asset, error.what_without_backtrace());
    } catch (const std::exception& error) {
      note_failure(asset, error.what());
    }
  }

  void note_failure(const loaders::AssetId& asset, const std::string& problem) {
    result_.failed[asset.id] = problem;
    if (result_.failed.size() <= kNamedInLog) log::warn("{}: {}", asset.id, problem);
  }

  void treat(const loaders::AssetId& asset, bool keep, LatentManifest& manifest) {
    const fs::path file = folder_.file(asset.id);
    std::optional<loaders::StructureLatent> latent;
    if (keep) latent = kept_latent(file);
    const bool kept = latent.has_value();
    // Of what is read next; before it, so that voxels that change in between are encoded again by the next run.
    const std::string inputs = kept ? std::string() : fingerprint_of_voxels(asset);
    std::optional<loaders::SparseStructureBatch> voxels;
    if (!kept || request_.check) voxels = coder_.voxels(asset);
    if (!kept) {
      coder_.encode(*voxels, file);
      manifest.add(asset.id, inputs);
      latent = loaders::read_structure_latent(file);
    }
    // Sums last: an asset that fails half way must not be in one of them only.
    LatentStatistics shape = result_.shape, skeleton = result_.skeleton;
    const auto add = [&](LatentStatistics& statistics, const loaders::LatentGrid& grid) {
      statistics.add(grid.values, static_cast<std::size_t>(grid.shape[0]), file.string());
    };
    add(shape, latent->mean);
    add(skeleton, latent->mean_skl);
    if (request_.check) {
      const StructureReconstruction one = coder_.agreement(*latent, *voxels);
      add_to(agreement_.shape, one.shape);
      add_to(agreement_.skeleton, one.skeleton);
    }
    result_.shape = std::move(shape);
    result_.skeleton = std::move(skeleton);
    finished_.insert(asset.id);
    (kept ? result_.up_to_date : result_.encoded) += 1;
  }

  void conclude() {
    const std::size_t count = finished_.size();
    if (count == 0) {
      folder_.remove_statistics();
    } else {
      folder_.write_statistics(result_.shape, result_.skeleton);
    }
    // Last, so that whoever finds the flags finds the statistics of the same latents.
    set_metadata_flag(request_.data, folder_.column(), finished_);
    if (!request_.check || count == 0) return;
    result_.reconstruction =
        StructureReconstruction{divided(agreement_.shape, count), divided(agreement_.skeleton, count)};
  }

  EncodeRequest request_;
  LatentFolder folder_;
  StructureCoder coder_;
  std::set<std::string> finished_;
  StructureReconstruction agreement_;  // sums
  EncodeResult result_;
};

}  // namespace

EncodeResult encode_sparse_structure(const EncodeRequest& request) { return StructureEncoding(request).run(); }

}  // namespace anigen::pipeline
