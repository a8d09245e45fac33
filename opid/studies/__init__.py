"""Study files and logs -> the records of a study, and back."""
