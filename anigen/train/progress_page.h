#pragma once
#include <cstdint>
#include <string>

#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"

namespace anigen::train {

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

/// True when the last `patience` values of a quantity, where smaller is better, hardly improve on the best before them:
/// none is below (1 − gain) of it. False with fewer than patience + 1 values. @param metrics rows of metrics.csv
bool has_stalled(const CsvTable& metrics, const std::string& quantity, std::int64_t patience, double gain);

}  // namespace anigen::train
