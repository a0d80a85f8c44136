#include "anigen/pipeline/latent_encoding.h"

#include <exception>
#include <limits>
#include <new>
#include <optional>
#include <set>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/file_lock.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"
#include "anigen/core/progress.h"
#include "anigen/nn/torch.h"
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

/// Latents of everything: what the next stage trains on, and what it leaves out, is for its own dataset to say.
loaders::RowFilter all_with(const std::string& flag) {
  loaders::RowFilter filter;
  filter.min_aesthetic_score = std::numeric_limits<double>::lowest();
  filter.drop_bad_skeleton = false;
  filter.required_flags = {flag};
  return filter;
}

/// One run over a dataset.
class LatentEncoding {
 public:
  LatentEncoding(const EncodeRequest& request, const LatentFolder& folder, LatentSource& source)
      : request_(checked(request)), folder_(folder), source_(source) {
    result_.name = folder_.name();
    result_.checkpoint = source_.checkpoint();
  }

  EncodedLatents run() {
    const torch::NoGradGuard no_grad;
    const FileLock dataset = share_dataset(request_.data);
    const std::optional<FileLock> latents = FileLock::try_lock(
        dataset_lock_file(request_.data).parent_path() / ("lock-" + folder_.column()), FileLock::Kind::kExclusive);
    if (!latents) throw InputError(folder_.path().string(), "", "another anigen-encode is writing these latents");
    const std::vector<loaders::AssetId> assets =
        loaders::select_assets(request_.data.string(), all_with(source_.required_flag()));
    result_.assets = assets.size();
    LatentManifest manifest(folder_.path(), source_.fingerprint());
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
  std::string inputs_of(const loaders::AssetId& asset) const { return fingerprint_of_files(source_.inputs(asset)); }

  /// Ids whose latents need not be made again.
  std::set<std::string> up_to_date(const std::vector<loaders::AssetId>& assets, const LatentManifest& manifest) const {
    std::set<std::string> kept;
    for (const loaders::AssetId& asset : assets) {
      throw_if_interrupted();
      if (request_.again || !manifest.has(asset.id)) continue;
      std::error_code error;
      try {
        const bool there = fs::is_regular_file(folder_.file(asset.id), error);
        if (there && manifest.up_to_date(asset.id, inputs_of(asset))) kept.insert(asset.id);
      } catch (const InputError&) {  // inputs that cannot be read: said when the asset's turn comes
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

  /// Nothing when the file went missing or was damaged since.
  std::optional<LatentValues> kept_latent(const fs::path& file) const {
    try {
      return source_.read(file);
    } catch (const InputError&) {
      return std::nullopt;
    }
  }

  void treat(const loaders::AssetId& asset, bool keep, LatentManifest& manifest) {
    const fs::path file = folder_.file(asset.id);
    std::optional<LatentValues> latent;
    if (keep) latent = kept_latent(file);
    const bool kept = latent.has_value();
    if (!kept) {
      // Of what is read next; before it, so that inputs that change in between are encoded again by the next run.
      const std::string inputs = inputs_of(asset);
      source_.encode(asset, file);
      manifest.add(asset.id, inputs);
      latent = source_.read(file);
    }
    // Sums last: an asset that fails half way must not be in one of them only.
    LatentStatistics shape = result_.shape, skeleton = result_.skeleton;
    shape.add(latent->shape, latent->shape_channels, file.string());
    skeleton.add(latent->skeleton, latent->skeleton_channels, file.string());
    source_.inspect(asset, file);
    result_.shape = std::move(shape);
    result_.skeleton = std::move(skeleton);
    finished_.insert(asset.id);
    (kept ? result_.up_to_date : result_.encoded) += 1;
  }

  void conclude() {
    if (finished_.empty()) {
      folder_.remove_statistics();
    } else {
      folder_.write_statistics(result_.shape, result_.skeleton, source_.normalized_channels());
    }
    // Last, so that whoever finds the flags finds the statistics of the same latents.
    set_metadata_flag(request_.data, folder_.column(), finished_);
  }

  EncodeRequest request_;
  LatentFolder folder_;
  LatentSource& source_;
  std::set<std::string> finished_;
  EncodedLatents result_;
};

}  // namespace

EncodedLatents encode_latents(const EncodeRequest& request, const LatentFolder& folder, LatentSource& source) {
  return LatentEncoding(request, folder, source).run();
}

Json to_json(const EncodedLatents& result) {
  Json failed = Json::object();
  for (const auto& [id, problem] : result.failed) failed[id] = problem;
  return {{"name", result.name},
          {"checkpoint", result.checkpoint.string()},
          {"assets", result.assets},
          {"encoded", result.encoded},
          {"up_to_date", result.up_to_date},
          {"failed", failed},
          {"feats", to_json(result.shape)},
          {"feats_skl", to_json(result.skeleton)}};
}

std::string to_text(const EncodedLatents& result, const std::string& kind) {
  return kind + "/" + result.name + ": " + std::to_string(result.encoded) + " encoded, " +
         std::to_string(result.up_to_date) + " up to date, " + std::to_string(result.failed.size()) + " failed, by " +
         result.checkpoint.string() + "\n";
}

}  // namespace anigen::pipeline
