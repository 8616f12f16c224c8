"""Published accuracies beside the testbed's, under each definition of an error that their texts allow."""
