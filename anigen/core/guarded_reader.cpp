#include "anigen/core/guarded_reader.h"

#include <new>
#include <stdexcept>
#include <utility>

#include "anigen/core/error.h"

namespace anigen {

namespace {

/// First byte of an answer. What was read follows, or place, '\0' and problem.
enum class Answer : char { kRead, kInputError, kNotSupported };

std::string refusal(Answer answer, const std::string& place, const std::string& problem) {
  return static_cast<char>(answer) + place + '\0' + problem;
}

std::string answer_of(const std::function<std::string()>& reader) {
  static const char* const kTooLarge = "reading it needs more memory than there is";
  try {
    return static_cast<char>(Answer::kRead) + reader();
  } catch (const NotSupportedError& error) {
    return refusal(Answer::kNotSupported, error.place(), error.problem());
  } catch (const InputError& error) {
    return refusal(Answer::kInputError, error.place(), error.problem());
  } catch (const Error& error) {
    return refusal(Answer::kInputError, "", error.what());
  } catch (const std::bad_alloc&) {
    return refusal(Answer::kInputError, "", kTooLarge);
  } catch (const std::length_error&) {
    return refusal(Answer::kInputError, "", kTooLarge);
  }
}

}  // namespace

std::string read_guarded(const std::string& file, const std::string& crashed, const ProcessLimits& limits,
                         const std::function<std::string()>& reader) {
  GuardedWork work = run_guarded([&reader] { return answer_of(reader); }, limits);
  if (!work.finished) {
    std::string problem = crashed;
    problem.replace(problem.find('%'), 1, work.failure);
    throw InputError(file, "", problem);
  }
  std::string& text = work.result;
  // A reader that a hostile file has taken over may answer anything.
  const std::size_t end = text.empty() ? std::string::npos : text.find('\0', 1);
  if (text.empty() || (static_cast<Answer>(text.front()) != Answer::kRead && end == std::string::npos))
    throw InputError(file, "", "its reader gave no answer that can be understood");
  const auto answer = static_cast<Answer>(text.front());
  if (answer == Answer::kRead) {
    text.erase(0, 1);
    return std::move(text);
  }
  const std::string place = text.substr(1, end - 1);
  std::string problem = text.substr(end + 1);
  if (answer == Answer::kInputError) throw InputError(file, place, problem);
  // NotSupportedError puts it there again.
  const std::string prefix = NotSupportedError("", "", "").problem();
  if (problem.compare(0, prefix.size(), prefix) == 0) problem.erase(0, prefix.size());
  throw NotSupportedError(file, place, problem);
}

}  // namespace anigen
