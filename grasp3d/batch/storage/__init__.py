"""Access to files by path or address, on this machine or an object store such as S3."""
