// HDF5 1.10 keeps a few kilobytes of every damaged file that it refuses.
#ifdef ATOMCAM_SANITIZED
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libhdf5\n";
}
#endif
