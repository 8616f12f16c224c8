"""Figures of the page with Bokeh, which loads slowly: imported only where a page is made."""
