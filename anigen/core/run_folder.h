#pragma once
#include <filesystem>
#include <optional>

namespace anigen {

/// Names of what is in the folder of a run of anigen-train, or of a published one.
struct RunFolder {
  std::filesystem::path root;

  std::filesystem::path config() const { return root / "config.json"; }  ///< resolved
  std::filesystem::path checkpoints() const { return root / "ckpts"; }
  std::filesystem::path metrics() const { return root / "metrics.csv"; }
  std::filesystem::path samples() const { return root / "samples"; }
  std::filesystem::path board() const { return root / "tb_logs"; }  ///< TensorBoard's
  std::filesystem::path command() const { return root / "command.txt"; }
  std::filesystem::path made_by() const { return root / "made_by.json"; }  ///< version, commit, compiler, LibTorch
  std::filesystem::path log() const { return root / "log.txt"; }
  std::filesystem::path progress() const { return root / "progress.html"; }  ///< curves and samples, for a browser
  std::filesystem::path profile() const { return root / "profile.md"; }
  std::filesystem::path lock() const { return root / "run.lock"; }
  std::filesystem::path restart() const { return root / "restart.json"; }  ///< of a restart under way

  bool has_config() const;
  bool has_checkpoints() const;  ///< a folder of them, perhaps empty
  /// The checkpoints' folder, or the root itself where it has none, such as one that holds nothing else.
  std::filesystem::path checkpoint_files() const { return has_checkpoints() ? checkpoints() : root; }

  /// The run whose folder, or whose ckpts/, a file lies in; nothing without a config.json.
  static std::optional<RunFolder> around(const std::filesystem::path& file);
};

}  // namespace anigen
