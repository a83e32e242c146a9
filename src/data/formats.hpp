#pragma once
// Functions per file format; stack.cpp and open_stack.cpp choose.

#include "data/stack.hpp"

namespace atomcam {

using Path = std::filesystem::path;

std::unique_ptr<StackWriter> write_tiff(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames);
std::unique_ptr<StackWriter> write_hdf5(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames);
std::unique_ptr<StackWriter> write_fits(const Path& file, Shape shape, const StackNotes& notes,
                                        std::uint64_t expected_frames);
std::unique_ptr<StackWriter> write_npy(const Path& file, Shape shape, const StackNotes& notes,
                                       std::uint64_t expected_frames);

/// What is read is told by its content; open_stack.cpp chooses.
std::unique_ptr<StackReader> read_tiff(const Path& file);
std::unique_ptr<StackReader> read_hdf5(const Path& file, const std::string& path);
std::unique_ptr<StackReader> read_fits(const Path& file);
std::unique_ptr<StackReader> read_npy(const Path& file);
std::unique_ptr<StackReader> read_npz(const Path& file, const std::string& name);
std::unique_ptr<StackReader> read_sif(const Path& file);
std::unique_ptr<StackReader> read_dcimg(const Path& file);

/// "cannot be written (No space left on device)"; `what` happened if the system has no word for it.
std::string cannot(const std::string& verb, int error_number, const std::string& what = {});

/// {"lab":"...","settings":{...}} without the closing brace; texts as JSON.
std::string open_notes(const StackNotes& notes);
/// From a JSON object with these two keys; `text` may have others.
StackNotes parse_notes(const Path& file, const std::string& text);

}  // namespace atomcam
