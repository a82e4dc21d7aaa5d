"""Small tools around the operating system: files, file names, processors, progress, version."""
