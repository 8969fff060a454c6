#include "palpate/record/hdf5_writer.h"

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <utility>

#include "palpate/common/error.h"

namespace palpate {
namespace {

constexpr Hdf5::Size kChunk = 4096;     // rows
constexpr std::size_t kTextBytes = 64;  // of a cell
constexpr unsigned kTruncate = 2;       // H5F_ACC_TRUNC
constexpr Hdf5::Id kDefault = 0;        // H5P_DEFAULT
constexpr int kSelect = 0;              // H5S_SELECT_SET
constexpr int kDeflate = 1;             // H5Z_FILTER_DEFLATE
const Hdf5::Size kUnlimited = ~Hdf5::Size{0};

}  // namespace

Hdf5Writer::Hdf5Writer(std::filesystem::path path, const std::vector<std::string>& columns)
    : path_(std::move(path)), hdf5_(Hdf5::library()) {
  if (columns.empty()) throw std::logic_error("a table needs at least one column");
  errno = 0;
  file_ = hdf5_.file_create(path_.c_str(), kTruncate, kDefault, kDefault);
  if (file_ < 0) throw InputError(path_.string(), "", std::string("cannot be written: ") + std::strerror(errno));
  text_ = hdf5_.type_copy(hdf5_.text_type);
  hdf5_.type_set_size(text_, kTextBytes);
  for (const std::string& name : columns) columns_.push_back({name, {}, -1, 0});
}

Hdf5Writer::~Hdf5Writer() {
  if (file_ < 0) return;
  for (const Column& column : columns_)
    if (column.dataset >= 0) hdf5_.dataset_close(column.dataset);
  hdf5_.type_close(text_);
  hdf5_.file_close(file_);
}

void Hdf5Writer::fail() const {
  throw RunError(path_.string() + ": cannot be written" + (errno != 0 ? std::string(": ") + std::strerror(errno) : ""));
}

template <typename Values>
Values& Hdf5Writer::next() {
  if (file_ < 0) throw std::logic_error(path_.string() + ": written to after close()");
  if (cells_ == columns_.size()) throw std::logic_error(path_.string() + ": too many cells in a row");
  Column& column = columns_[cells_++];
  if (rows_ == 0) column.waiting = Values();
  if (!std::holds_alternative<Values>(column.waiting))
    throw std::logic_error(path_.string() + ": " + column.name + " holds cells of several kinds");
  return std::get<Values>(column.waiting);
}

void Hdf5Writer::put(double value) { next<std::vector<double>>().push_back(value); }
void Hdf5Writer::put(std::int64_t value) { next<std::vector<std::int64_t>>().push_back(value); }
void Hdf5Writer::put(std::string_view value) {
  auto& texts = next<std::string>();
  if (value.size() > kTextBytes) throw std::logic_error(path_.string() + ": a text is longer than 64 bytes");
  texts.append(value);
  texts.append(kTextBytes - value.size(), '\0');
}

void Hdf5Writer::endRow() {
  if (cells_ != columns_.size()) {
    throw std::logic_error(path_.string() + ": row of " + std::to_string(cells_) + " cells in a table of " +
                           std::to_string(columns_.size()) + " columns");
  }
  cells_ = 0;
  ++rows_;
  if (++waiting_ % kChunk == 0) writeWaiting();
}

void Hdf5Writer::create(Column& column, Hdf5::Id type) {
  const Hdf5::Size none = 0;
  const Hdf5::Id space = hdf5_.space_create(1, &none, &kUnlimited);
  const Hdf5::Id properties = hdf5_.property_create(hdf5_.dataset_properties);
  hdf5_.set_chunk(properties, 1, &kChunk);
  hdf5_.track_times(properties, false);
  if (hdf5_.filter_available(kDeflate) > 0) {
    hdf5_.set_shuffle(properties);
    hdf5_.set_deflate(properties, 1);
  }
  const Hdf5::Id access = hdf5_.property_create(hdf5_.dataset_access);
  hdf5_.set_chunk_cache(access, 1, 0, 1.0);  // none: a chunk is written when it is full, and what fails fails then
  column.dataset = hdf5_.dataset_create(file_, column.name.c_str(), type, space, kDefault, properties, access);
  hdf5_.property_close(access);
  hdf5_.property_close(properties);
  hdf5_.space_close(space);
  if (column.dataset < 0) fail();
}

void Hdf5Writer::write(Column& column, const void* data, Hdf5::Id type, Hdf5::Size rows) {
  errno = 0;
  if (column.dataset < 0) create(column, type);
  const Hdf5::Size all = rows_;
  if (hdf5_.set_extent(column.dataset, &all) < 0) fail();
  if (rows == 0) return;
  const Hdf5::Size first = all - rows;
  const Hdf5::Id memory = hdf5_.space_create(1, &rows, nullptr);
  const Hdf5::Id file = hdf5_.dataset_space(column.dataset);
  const bool written = hdf5_.select(file, kSelect, &first, nullptr, &rows, nullptr) >= 0 &&
                       hdf5_.dataset_write(column.dataset, type, memory, file, kDefault, data) >= 0;
  hdf5_.space_close(file);
  hdf5_.space_close(memory);
  if (!written) fail();
}

// Columns that are in the file already, as a later one failed, are written again to the same place.
void Hdf5Writer::writeWaiting() {
  for (Column& column : columns_) {
    if (column.written == rows_ && column.dataset >= 0) continue;
    if (auto* const numbers = std::get_if<std::vector<double>>(&column.waiting)) {
      write(column, numbers->data(), hdf5_.double_type, numbers->size());
    } else if (auto* const integers = std::get_if<std::vector<std::int64_t>>(&column.waiting)) {
      write(column, integers->data(), hdf5_.integer_type, integers->size());
    } else if (auto* const texts = std::get_if<std::string>(&column.waiting)) {
      write(column, texts->data(), text_, texts->size() / kTextBytes);
    } else {
      write(column, nullptr, hdf5_.double_type, 0);
    }
    column.written = rows_;
  }
  for (Column& column : columns_) {
    std::visit(
        [](auto& values) {
          if constexpr (!std::is_same_v<std::decay_t<decltype(values)>, std::monostate>) values.clear();
        },
        column.waiting);
  }
  waiting_ = 0;
}

void Hdf5Writer::close() {
  if (file_ < 0) return;
  if (cells_ != 0) throw std::logic_error(path_.string() + ": closed in the middle of a row");
  writeWaiting();
  errno = 0;
  bool good = true;
  for (Column& column : columns_) good = hdf5_.dataset_close(std::exchange(column.dataset, -1)) >= 0 && good;
  hdf5_.type_close(text_);
  good = hdf5_.file_close(std::exchange(file_, -1)) >= 0 && good;
  if (!good) fail();
}

}  // namespace palpate
