"""What comes of tracking a source: the loop, the files, the plots."""
