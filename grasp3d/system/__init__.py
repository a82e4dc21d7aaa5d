"""What any program needs: files, their names, processors, progress, versions."""
