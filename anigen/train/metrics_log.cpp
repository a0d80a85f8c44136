#include "anigen/train/metrics_log.h"

#include <unistd.h>
#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <system_error>
#include <utility>
#include <vector>

#include "anigen/core/chart.h"
#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/text.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

std::string number_text(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  return Json(value).dump();
}

std::string csv_line(const std::vector<std::string>& cells) { return joined(cells, ",", csv_field) + "\n"; }

// Without a last line that a crash cut short.
CsvTable read_table(const fs::path& file) {
  CsvTable table;
  table.columns = {"step"};
  std::error_code error;
  if (!fs::exists(file, error)) return table;
  std::string text = read_file(file);
  text.erase(text.rfind('\n') == std::string::npos ? 0 : text.rfind('\n') + 1);
  if (!text.empty()) table = parse_csv(text, file.string());
  if (table.columns.empty() || table.columns[0] != "step")
    throw InputError(file.string(), "line 1", "is no metrics table: the first column must be 'step'");
  return table;
}

void drop_rows(CsvTable& table, std::int64_t step, bool after) {
  auto& rows = table.rows;
  rows.erase(std::remove_if(rows.begin(), rows.end(),
                            [&](const auto& row) { return (std::atoll(row[0].c_str()) > step) == after; }),
             rows.end());
}

std::array<std::uint32_t, 256> make_table() {
  std::array<std::uint32_t, 256> table{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t c = i;
    for (int bit = 0; bit < 8; ++bit) c = c & 1 ? (c >> 1) ^ 0x82F63B78u : c >> 1;
    table[i] = c;
  }
  return table;
}

// Protobuf wire format: a key is field << 3 | type, type 0 a varint, 1 eight bytes, 2 length-delimited, 5 four bytes.
void put_varint(std::string& out, std::uint64_t value) {
  for (; value >= 0x80; value >>= 7) out.push_back(static_cast<char>(value | 0x80));
  out.push_back(static_cast<char>(value));
}

template <typename T>
void put_bytes(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

void put_integer(std::string& out, int field, std::uint64_t value) {
  put_varint(out, static_cast<std::uint64_t>(field) << 3);
  put_varint(out, value);
}

// Of a double or a float.
template <typename T>
void put_number(std::string& out, int field, T value) {
  put_varint(out, static_cast<std::uint64_t>(field) << 3 | (sizeof(T) == 8 ? 1 : 5));
  put_bytes(out, value);
}

void put_string(std::string& out, int field, std::string_view text) {
  put_varint(out, static_cast<std::uint64_t>(field) << 3 | 2);
  put_varint(out, text.size());
  out.append(text);
}

// Field numbers of tensorflow.Event, Summary, Summary.Value, Summary.Image and SessionLog.
enum EventField { kWallTime = 1, kStep = 2, kFileVersion = 3, kSummary = 5, kSessionLog = 7 };
enum SummaryField { kValue = 1, kTag = 1, kSimpleValue = 2, kImage = 4 };
enum ImageField { kHeight = 1, kWidth = 2, kColorspace = 3, kEncoded = 4 };

std::string summary(const std::string& value) {
  std::string message, event_part;
  put_string(message, kValue, value);
  put_string(event_part, kSummary, message);
  return event_part;
}

double seconds_now() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace

CsvTable metrics_after(const fs::path& file, std::int64_t step) {
  CsvTable table = read_table(file);
  drop_rows(table, step, /*after=*/false);
  return table;
}

MetricsLog::MetricsLog(fs::path file, std::int64_t last_step) : file_(std::move(file)), table_(read_table(file_)) {
  drop_rows(table_, last_step, /*after=*/true);
  write_file_atomically(file_, to_csv(table_));
}

void MetricsLog::append(std::int64_t step, const Values& values) {
  const std::size_t columns_before = table_.columns.size();
  std::vector<std::string> row(columns_before);
  row[0] = std::to_string(step);
  for (const auto& [name, value] : values) {
    std::size_t column = table_.column(name);
    if (column == CsvTable::kMissing) {
      column = table_.columns.size();
      table_.columns.push_back(name);
      row.emplace_back();
    }
    row[column] = number_text(value);
  }
  table_.rows.push_back(row);
  if (table_.columns.size() != columns_before) {
    for (auto& each : table_.rows) each.resize(table_.columns.size());
    write_file_atomically(file_, to_csv(table_));
    return;
  }
  std::ofstream out(file_, std::ios::app | std::ios::binary);
  out << csv_line(row) << std::flush;
  if (!out) throw Error(file_.string() + ": cannot write");
}

void RunningMeans::add_sum(const Entry& other) {
  auto found =
      std::find_if(entries.begin(), entries.end(), [&](const Entry& entry) { return entry.name == other.name; });
  if (found == entries.end()) found = entries.insert(entries.end(), Entry{other.name});
  if (only_finite && !std::isfinite(other.sum)) return;
  found->sum += other.sum;
  found->count += other.count;
}

Values RunningMeans::means() const {
  Values values;
  for (const Entry& entry : entries)
    values.emplace_back(entry.name, entry.count > 0 ? entry.sum / static_cast<double>(entry.count) : std::nan(""));
  return values;
}

std::uint32_t crc32c(std::string_view bytes) {
  static const std::array<std::uint32_t, 256> table = make_table();
  std::uint32_t c = 0xFFFFFFFFu;
  for (const unsigned char byte : bytes) c = table[(c ^ byte) & 0xFF] ^ (c >> 8);
  return c ^ 0xFFFFFFFFu;
}

std::uint32_t masked_crc32c(std::string_view bytes) {
  const std::uint32_t c = crc32c(bytes);
  return ((c >> 15) | (c << 17)) + 0xA282EAD8u;
}

TensorBoardWriter::TensorBoardWriter(const fs::path& folder, std::int64_t first_step) {
  std::error_code error;
  fs::create_directories(folder, error);
  char host[256] = "host";
  ::gethostname(host, sizeof host - 1);
  path_ = folder / ("events.out.tfevents." + std::to_string(static_cast<long long>(seconds_now())) + "." + host + "." +
                    std::to_string(::getpid()));
  file_ = std::fopen(path_.c_str(), "ab");
  if (file_ == nullptr) throw Error(path_.string() + ": cannot write: " + std::strerror(errno));
  std::string version, mark, session;
  put_string(version, kFileVersion, "brain.Event:2");
  write_event(0, version);
  put_integer(session, 1, 1);  // SessionLog.status = START
  put_string(mark, kSessionLog, session);
  write_event(first_step, mark);
}

TensorBoardWriter::~TensorBoardWriter() { std::fclose(file_); }

void TensorBoardWriter::write_event(std::int64_t step, const std::string& payload) {
  std::string event;
  put_number(event, kWallTime, seconds_now());
  if (step != 0) put_integer(event, kStep, static_cast<std::uint64_t>(step));
  event += payload;
  std::string length, frame;
  put_bytes(length, static_cast<std::uint64_t>(event.size()));
  frame = length;
  put_bytes(frame, masked_crc32c(length));
  frame += event;
  put_bytes(frame, masked_crc32c(event));
  if (std::fwrite(frame.data(), 1, frame.size(), file_) != frame.size())
    throw Error(path_.string() + ": cannot write: " + std::strerror(errno));
}

void TensorBoardWriter::scalar(const std::string& tag, double value, std::int64_t step) {
  std::string entry;
  put_string(entry, kTag, tag);
  put_number(entry, kSimpleValue, static_cast<float>(value));
  write_event(step, summary(entry));
}

void TensorBoardWriter::image(const std::string& tag, const std::vector<std::uint8_t>& png, int width, int height,
                              std::int64_t step) {
  std::string picture, entry;
  put_integer(picture, kHeight, static_cast<std::uint64_t>(height));
  put_integer(picture, kWidth, static_cast<std::uint64_t>(width));
  put_integer(picture, kColorspace, 4);  // RGBA
  put_string(picture, kEncoded, {reinterpret_cast<const char*>(png.data()), png.size()});
  put_string(entry, kTag, tag);
  put_string(entry, kImage, picture);
  write_event(step, summary(entry));
}

void TensorBoardWriter::flush() {
  if (std::fflush(file_) != 0) throw Error(path_.string() + ": cannot write: " + std::strerror(errno));
}

namespace {

using Points = std::vector<std::pair<double, double>>;

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

double number(const CsvTable& table, std::size_t row, const std::string& column) {
  const std::string& cell = table.cell(row, column);
  return cell.empty() ? kMissing : std::strtod(cell.c_str(), nullptr);
}

// A column against samples, or against hours of training.
Points points_of(const CsvTable& metrics, const std::string& column, const RunFacts& facts, bool by_hours) {
  Points points;
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    const double value = number(metrics, row, column);
    if (!std::isfinite(value)) continue;
    const double x = by_hours ? number(metrics, row, "time.elapsed_s") / 3600.0
                              : number(metrics, row, "step") * static_cast<double>(facts.batch_size);
    points.emplace_back(x, value);
  }
  return points;
}

bool starts_with(const std::string& text, const char* with) { return text.rfind(with, 0) == 0; }

std::string charts(const CsvTable& metrics, const char* prefix, const RunFacts& facts, bool by_hours) {
  std::string html;
  for (const std::string& column : metrics.columns) {
    if (!starts_with(column, prefix)) continue;
    html += line_chart(column + (by_hours ? " by hours" : " by samples"), points_of(metrics, column, facts, by_hours));
  }
  return html;
}

std::int64_t step_of(const fs::path& folder) {
  const std::string name = folder.filename().string();
  return starts_with(name, "step") ? std::strtoll(name.c_str() + 4, nullptr, 10) : -1;
}

// Pictures of the folder of the latest step, by their paths below the run.
std::string newest_pictures(const RunFolder& run) {
  constexpr std::size_t kMost = 24;
  std::error_code error;
  fs::path newest;
  for (const fs::directory_entry& entry : fs::directory_iterator(run.samples(), error)) {
    if (step_of(entry.path()) > (newest.empty() ? -1 : step_of(newest))) newest = entry.path();
  }
  if (newest.empty()) return "";
  std::string html = "<h2>Samples of step " + std::to_string(step_of(newest)) + "</h2>\n";
  std::vector<std::string> pictures;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(newest, error)) {
    if (entry.path().extension() == ".png") pictures.push_back(entry.path().lexically_relative(run.root).string());
  }
  std::sort(pictures.begin(), pictures.end());
  if (pictures.size() > kMost) pictures.resize(kMost);
  for (const std::string& picture : pictures) {
    html += "<figure><img src=\"" + html_escaped(picture) + "\"><figcaption>" + html_escaped(picture) +
            "</figcaption></figure>\n";
  }
  return html;
}

std::string hours_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f h", seconds / 3600.0);
  return text;
}

}  // namespace

std::string progress_page(const RunFolder& run, const CsvTable& metrics, const RunFacts& facts) {
  const std::size_t rows = metrics.rows.size();
  const double step = rows == 0 ? 0.0 : number(metrics, rows - 1, "step");
  double elapsed = 0.0;
  for (std::size_t row = 0; row < rows; ++row) {
    const double seconds = number(metrics, row, "time.elapsed_s");
    if (std::isfinite(seconds)) elapsed = seconds;
  }
  const double left = step > 0.0 ? elapsed * (static_cast<double>(facts.max_steps) - step) / step : 0.0;
  std::string html =
      "<!doctype html>\n<meta charset=\"utf-8\"><title>" + html_escaped(facts.title) +
      "</title>\n<style>body{font:15px/1.45 sans-serif;max-width:1300px;margin:2em auto;padding:0 1em;color:#222}"
      "svg{margin:.4em}figure{display:inline-block;margin:.5em}img{max-width:400px}figcaption{font-size:12px}</style>\n"
      "<h1>" +
      html_escaped(facts.title) + "</h1>\n<p>Step " + std::to_string(std::llround(step)) + " of " +
      std::to_string(facts.max_steps) + ", " +
      std::to_string(std::llround(step * static_cast<double>(facts.batch_size))) + " samples, " + hours_text(elapsed) +
      " of training" + (left > 0.0 ? ", about " + hours_text(left) + " left" : std::string()) + ".</p>\n";
  html +=
      "<h2>Held-out metrics</h2>\n" + charts(metrics, "eval.", facts, false) + charts(metrics, "eval.", facts, true);
  html += "<h2>Losses</h2>\n" + charts(metrics, "loss.", facts, false);
  html += "<h2>Learning rate, gradients, speed</h2>\n" + charts(metrics, "status.", facts, false) +
          charts(metrics, "time.samples_per_s", facts, false);
  return html + newest_pictures(run);
}

bool has_evaluation(const CsvTable& metrics, std::int64_t step) {
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    if (metrics.cell(row, "step") != std::to_string(step)) continue;
    for (const std::string& column : metrics.columns) {
      if (starts_with(column, "eval.") && !metrics.cell(row, column).empty()) return true;
    }
  }
  return false;
}

bool is_larger_better(const std::string& quantity) {
  const std::string name = quantity.substr(quantity.rfind('.') + 1);
  const auto begins_with = [&](const char* word) { return name.rfind(word, 0) == 0; };
  constexpr const char* kShares[] = {"iou", "f1", "precision", "recall", "cos", "psnr", "ssim", "surfaces", "family"};
  return std::any_of(std::begin(kShares), std::end(kShares), begins_with);
}

bool has_stalled(const CsvTable& metrics, const std::string& quantity, std::int64_t patience, double gain) {
  std::vector<double> values;
  const bool larger = is_larger_better(quantity);
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    const double value = number(metrics, row, quantity);
    if (std::isfinite(value)) values.push_back(value);
  }
  const auto recent = static_cast<std::size_t>(std::max<std::int64_t>(1, patience));
  if (values.size() <= recent) return false;
  const auto middle = values.end() - static_cast<std::ptrdiff_t>(recent);
  if (larger) return *std::max_element(middle, values.end()) < *std::max_element(values.begin(), middle) * (1.0 + gain);
  return *std::min_element(middle, values.end()) > *std::min_element(values.begin(), middle) * (1.0 - gain);
}

}  // namespace anigen::train
