#include "anigen/generate/encode.h"

#include <limits>
#include <optional>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/lease.h"
#include "anigen/core/log.h"
#include "anigen/core/table.h"
#include "anigen/core/version.h"
#include "anigen/nn/torch.h"

namespace anigen::generate {

namespace {

namespace fs = std::filesystem;

fs::path table_of(const fs::path& root) { return root / "metadata.csv"; }

/// Others hold it for one change of the table, so it is worth waiting for.
FileLock lock_table(const fs::path& root) {
  return wait_for_lock(dataset_lock_file(root).parent_path() / "lock-metadata", FileLock::Kind::kExclusive);
}

constexpr std::size_t kNamedInLog = 20;

const EncodeRequest& checked(const EncodeRequest& request) {
  if (request.data.string().find(',') != std::string::npos) {
    throw InputError("", "--dataset",
                     "names one dataset; encode several one after another (its path may hold no comma)");
  }
  return request;
}

/// Latents of everything: what the next stage trains on, and what it leaves out, is for its own dataset to say.
data::RowFilter all_with(const std::string& flag) {
  data::RowFilter filter;
  filter.min_aesthetic_score = std::numeric_limits<double>::lowest();
  filter.drop_bad_skeleton = false;
  filter.required_flags = {flag};
  return filter;
}

// Keeps anigen-prepare from writing the tables of a dataset as long as the lock is held.
FileLock share_dataset(const fs::path& root) {
  std::error_code error;
  // First, so that no lock file is made in a folder that is no dataset.
  if (!fs::is_regular_file(table_of(root), error)) throw InputError(table_of(root).string(), "", "no such file");
  std::optional<FileLock> lock;
  while_group_is_empty(dataset_prepare_lock_file(root),
                       [&] { lock = FileLock::try_lock(dataset_lock_file(root), FileLock::Kind::kShared); });
  if (!lock)
    throw InputError(root.string(), "", "anigen-prepare is working on this dataset; wait until it has finished");
  return std::move(*lock);
}

/// One run over a dataset, or this process' part of it.
class LatentEncoding {
 public:
  LatentEncoding(const EncodeRequest& request, const LatentFolder& folder, LatentSource& source)
      : request_(checked(request)),
        folder_(folder),
        source_(source),
        outcomes_(request.data, folder.column()),
        fingerprint_(source.fingerprint()),
        encoder_{{"fingerprint", fingerprint_}, {"again", request.again}} {
    result_.name = folder_.name();
    result_.checkpoint = source_.checkpoint();
  }

  EncodedLatents run() {
    const torch::NoGradGuard no_grad;
    const FileLock dataset = share_dataset(request_.data);
    assets_ = data::select_assets(request_.data.string(), all_with(source_.required_flag()));
    result_.assets = assets_.size();
    const std::optional<FileLock> latents = join_group(lock_file(""), [this](bool first) {
      if (first) {
        begin();
      } else if (!outcomes_.join(encoder_, kept_)) {
        throw InputError(folder_.path().string(), "", "another anigen-encode is writing these latents");
      }
    });
    if (!latents) throw InputError(folder_.path().string(), "", "another anigen-encode is writing these latents");
    encode();
    // Whoever is first concludes for all; the others only read what came of it.
    const FileLock conclusion = wait_for_lock(lock_file("-conclusion"), FileLock::Kind::kExclusive);
    collect();
    if (!outcomes_.concluded()) conclude();
    return result_;
  }

 private:
  fs::path lock_file(const std::string& part) const {
    return dataset_lock_file(request_.data).parent_path() / ("lock-" + folder_.column() + part);
  }

  std::string inputs_of(const data::AssetId& asset) const { return fingerprint_of_files(source_.inputs(asset)); }

  /// The first process, while others wait, finds what can be kept and takes back what was promised of the rest.
  void begin() {
    LatentManifest manifest(folder_.path(), fingerprint_);
    for (const bool again : {false, true}) {
      const Json encoder{{"fingerprint", fingerprint_}, {"again", again}};
      for (const auto& [id, outcome] : outcomes_.encoded_by(encoder)) manifest.add(id, outcome.inputs, outcome.commit);
    }
    manifest.save();  // before what it was read from is removed
    kept_ = up_to_date(manifest);
    if (!request_.accept_other_code) leave_out_other_code(manifest);
    invalidate_others(manifest);
    outcomes_.begin(encoder_, kept_);
  }

  /// Ids whose latents need not be made again.
  std::set<std::string> up_to_date(const LatentManifest& manifest) const {
    std::set<std::string> kept;
    for (const data::AssetId& asset : assets_) {
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

  /// Latents of another build of the program are encoded again, which is said once.
  void leave_out_other_code(const LatentManifest& manifest) {
    std::set<std::string> own;
    std::string other;
    for (const std::string& id : kept_) {
      if (manifest.commit_of(id) == commit()) {
        own.insert(id);
      } else {
        other = manifest.commit_of(id);
      }
    }
    if (own.size() < kept_.size()) {
      log::warn("{} latents of {} were encoded by {}; {} encodes them again (--accept-other-code keeps them)",
                kept_.size() - own.size(), folder_.path().string(), named_commit(other), named_commit(commit()));
    }
    kept_ = std::move(own);
  }

  /// Before the first file is replaced nothing may promise it any more, neither to training nor to the next run.
  void invalidate_others(LatentManifest& manifest) const {
    std::vector<std::string> others;
    for (const data::AssetId& asset : assets_) {
      if (kept_.count(asset.id) == 0) others.push_back(asset.id);
    }
    if (others.empty()) return;
    set_metadata_flag(request_.data, folder_.column(), kept_);
    folder_.remove_statistics();
    manifest.forget(others);
  }

  /// Until every asset has an outcome, of this process or of another one.
  void encode() {
    std::vector<std::string> names;
    for (const data::AssetId& asset : assets_) names.push_back(asset.id);
    std::vector<char> seen(assets_.size(), 0);
    std::size_t count = 0;
    Progress progress("encoding", assets_.size(), "assets");
    const LeaseFolder leases(outcomes_.leases());
    const auto done = [&](std::size_t i) {
      if (seen[i] == 0 && outcomes_.read(names[i])) {
        seen[i] = 1;
        ++count;
        progress.advance();
      }
      return seen[i] != 0;
    };
    work_in_turn(leases, names, done, [&](std::size_t i) {
      outcomes_.write(names[i], attempt(assets_[i]));
      done(i);
      if (request_.progress) request_.progress(count, assets_.size());
    });
    progress.finish();
  }

  LatentOutcome attempt(const data::AssetId& asset) {
    LatentOutcome failed;
    try {
      return treat(asset);
    } catch (...) {
      failed.failure = failure_of_item();
    }
    return failed;
  }

  /// Nothing when the file went missing or was damaged since.
  std::optional<LatentValues> kept_latent(const fs::path& file) const {
    try {
      return source_.read(file);
    } catch (const InputError&) {
      return std::nullopt;
    }
  }

  LatentOutcome treat(const data::AssetId& asset) {
    const fs::path file = folder_.file(asset.id);
    LatentOutcome outcome;
    std::optional<LatentValues> latent;
    if (kept_.count(asset.id) > 0) latent = kept_latent(file);
    if (!latent) {
      // Of what is read next; before it, so that inputs that change in between are encoded again by the next run.
      outcome.inputs = inputs_of(asset);
      source_.encode(asset, file);
      latent = source_.read(file);
      outcome.commit = commit();
    }
    outcome.shape = moments_of(latent->shape, latent->shape_channels, file.string());
    outcome.skeleton = moments_of(latent->skeleton, latent->skeleton_channels, file.string());
    source_.inspect(asset, file);
    return outcome;
  }

  void note_failure(const std::string& id, const std::string& problem) {
    result_.failed[id] = problem;
    if (result_.failed.size() <= kNamedInLog) log::warn("{}: {}", id, problem);
  }

  /// All outcomes, in the order of the dataset, so that sums do not depend on who encoded what.
  void collect() {
    for (const data::AssetId& asset : assets_) {
      const std::optional<LatentOutcome> outcome = outcomes_.read(asset.id);
      if (!outcome) throw Error(folder_.path().string() + ": what became of " + asset.id + " is not to be found");
      if (!outcome->failure.empty()) {
        note_failure(asset.id, outcome->failure);
        continue;
      }
      if (!outcome->inputs.empty()) written_[asset.id] = *outcome;
      // Sums last: an asset that fails half way must not be in one of them only.
      LatentStatistics shape = result_.shape, skeleton = result_.skeleton;
      try {
        shape.add(outcome->shape, folder_.file(asset.id).string());
        skeleton.add(outcome->skeleton, folder_.file(asset.id).string());
      } catch (const InputError& problem) {
        note_failure(asset.id, problem.what());
        continue;
      }
      result_.shape = std::move(shape);
      result_.skeleton = std::move(skeleton);
      finished_.insert(asset.id);
      (outcome->inputs.empty() ? result_.up_to_date : result_.encoded) += 1;
    }
  }

  void conclude() {
    LatentManifest manifest(folder_.path(), fingerprint_);
    for (const auto& [id, outcome] : written_) manifest.add(id, outcome.inputs, outcome.commit);
    manifest.save();
    if (finished_.empty()) {
      folder_.remove_statistics();
    } else {
      folder_.write_statistics(result_.shape, result_.skeleton, source_.normalized_channels());
    }
    // Last, so that whoever finds the flags finds the statistics of the same latents.
    set_metadata_flag(request_.data, folder_.column(), finished_);
    outcomes_.set_concluded();
  }

  EncodeRequest request_;
  LatentFolder folder_;
  LatentSource& source_;
  LatentOutcomes outcomes_;
  std::string fingerprint_;
  Json encoder_;
  std::vector<data::AssetId> assets_;
  std::set<std::string> kept_, finished_;
  std::map<std::string, LatentOutcome> written_;  // of the latents that this run wrote, by id
  EncodedLatents result_;
};

}  // namespace

void set_metadata_flag(const fs::path& root, const std::string& column, const std::set<std::string>& ids) {
  const FileLock dataset = share_dataset(root);
  const FileLock lock = lock_table(root);
  const fs::path file = table_of(root);
  CsvTable table = read_csv(file);
  if (table.column("sha256") == CsvTable::kMissing) throw InputError(file.string(), "sha256", "no such column");
  const std::string before = to_csv(table);
  std::size_t place = table.column(column);
  if (place == CsvTable::kMissing) {
    place = table.columns.size();
    table.columns.push_back(column);
    for (auto& row : table.rows) row.emplace_back();
  }
  for (std::size_t row = 0; row < table.rows.size(); ++row)
    table.rows[row][place] = csv_flag(ids.count(table.cell(row, "sha256")) > 0);
  const std::string after = to_csv(table);
  if (after != before) write_file_atomically(file, after);
}

EncodedLatents encode_latents(const EncodeRequest& request, const LatentFolder& folder, LatentSource& source) {
  return LatentEncoding(request, folder, source).run();
}

Json to_json(const EncodedLatents& result) {
  return {{"name", result.name},
          {"checkpoint", result.checkpoint.string()},
          {"assets", result.assets},
          {"encoded", result.encoded},
          {"up_to_date", result.up_to_date},
          {"failed", result.failed},
          {"feats", to_json(result.shape)},
          {"feats_skl", to_json(result.skeleton)}};
}

std::string to_text(const EncodedLatents& result, const std::string& kind) {
  return kind + "/" + result.name + ": " + std::to_string(result.encoded) + " encoded, " +
         std::to_string(result.up_to_date) + " up to date, " + std::to_string(result.failed.size()) + " failed, by " +
         result.checkpoint.string() + "\n";
}

}  // namespace anigen::generate
