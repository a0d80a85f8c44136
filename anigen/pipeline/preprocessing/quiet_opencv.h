#pragma once
#include <opencv2/core.hpp>
#include <opencv2/core/utils/logger.hpp>

namespace anigen::pipeline {

/// Keeps OpenCV from writing its own account of an error to the terminal while it is caught and said in our words.
/// The setting is the process's: for code that one thread runs at a time.
class QuietOpenCv {
 public:
  QuietOpenCv() : level_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {
    cv::redirectError([](int, const char*, const char*, const char*, int, void*) { return 0; });
  }
  ~QuietOpenCv() {
    cv::redirectError(nullptr);
    cv::utils::logging::setLogLevel(level_);
  }
  QuietOpenCv(const QuietOpenCv&) = delete;
  QuietOpenCv& operator=(const QuietOpenCv&) = delete;

 private:
  cv::utils::logging::LogLevel level_;
};

}  // namespace anigen::pipeline
