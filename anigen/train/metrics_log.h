#pragma once
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"

namespace anigen::train {

/// Names with their values, in order.
using Values = std::vector<std::pair<std::string, double>>;

/// A run's metrics.csv: one row per logged step, one column per quantity, the first one "step"; empty cells where a
/// step did not have a quantity. Doubles are written so that they read back exactly.
class MetricsLog {
 public:
  /// Opens or creates the file and drops rows after `last_step`, which a resumed run will write again, and a last
  /// line that a crash cut short. @throws InputError when the file is there but is no such table
  MetricsLog(std::filesystem::path file, std::int64_t last_step);

  /// Appends a row; a quantity that is new adds a column, for which the file is written again.
  void append(std::int64_t step, const Values& values);

  const CsvTable& table() const { return table_; }

 private:
  std::filesystem::path file_;
  CsvTable table_;
};

/// Rows of a metrics.csv after a step; none when there is no such file. @throws InputError when it is no such table
CsvTable metrics_after(const std::filesystem::path& file, std::int64_t step);

/// Sums of per-step values between two log rows, or of held-out assets; their mean is logged.
class RunningMeans {
 public:
  struct Entry {
    std::string name;
    double sum = 0.0;
    std::int64_t count = 0;
  };

  void add(const std::string& name, double value) { add_sum({name, value, 1}); }
  /// Adds a sum that was taken elsewhere.
  void add_sum(const Entry& other);
  Values means() const;
  void clear() { entries.clear(); }

  bool only_finite = true;     ///< values that are not finite do not count
  std::vector<Entry> entries;  ///< also what a checkpoint keeps, so that resumed runs log the same rows
};

/// CRC-32C (Castagnoli polynomial, reflected).
std::uint32_t crc32c(std::string_view bytes);
/// The checksum TFRecord files store: rotated right by 15 bits plus 0xA282EAD8.
std::uint32_t masked_crc32c(std::string_view bytes);

/// Appends scalars and pictures to a TensorBoard event file: TFRecord frames around protobuf messages of type
/// tensorflow.Event (event.proto and summary.proto of TensorFlow), encoded by hand. A resumed run writes a file of
/// its own that starts with a session mark, upon which TensorBoard forgets what was logged from that step on.
class TensorBoardWriter {
 public:
  /// Creates `<folder>/events.out.tfevents.<seconds>.<host>.<process>`. @throws Error when that fails
  /// @param first_step steps from here on replace older entries
  TensorBoardWriter(const std::filesystem::path& folder, std::int64_t first_step);
  ~TensorBoardWriter();
  TensorBoardWriter(const TensorBoardWriter&) = delete;
  TensorBoardWriter& operator=(const TensorBoardWriter&) = delete;

  void scalar(const std::string& tag, double value, std::int64_t step);
  /// @param png an encoded RGBA picture of that size
  void image(const std::string& tag, const std::vector<std::uint8_t>& png, int width, int height, std::int64_t step);
  void flush();
  const std::filesystem::path& path() const { return path_; }

 private:
  void write_event(std::int64_t step, const std::string& payload);

  std::filesystem::path path_;
  std::FILE* file_ = nullptr;
};

/// Facts of a run that its metrics do not tell.
struct RunFacts {
  std::string title;
  std::int64_t max_steps = 0;
  std::size_t batch_size = 1;
};

/// Page of a run for a browser: step, hours and expected end; curves of the losses and of the held-out metrics against
/// samples seen, held-out metrics against hours, samples per second; the newest sample pictures, which the page refers
/// to beside itself. @param metrics of metrics.csv (MetricsLog)
std::string progress_page(const RunFolder& run, const CsvTable& metrics, const RunFacts& facts);

/// True when a row of this step has a held-out metric. @param metrics rows of metrics.csv
bool has_evaluation(const CsvTable& metrics, std::int64_t step);

/// True for a held-out metric that grows as models get better, by the first letters of its name: shares as IoU, F1,
/// precision and recall, cosines, PSNR and SSIM; all others are errors. @param quantity such as "eval.iou_skl"
bool is_larger_better(const std::string& quantity);

/// True when the last `patience` values of a quantity hardly improve on the best before them: none is below (1 − gain)
/// of it, or above (1 + gain) where larger is better. False with fewer than patience + 1 values.
/// @param metrics rows of metrics.csv
bool has_stalled(const CsvTable& metrics, const std::string& quantity, std::int64_t patience, double gain);

}  // namespace anigen::train
